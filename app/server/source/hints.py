"""Suggestions for sources to open."""

from __future__ import annotations

import functools

from app.contract.status import SourceEntry
from observer.simulation.scenarios import load_scenario, scenario_names

_HINTS = (
    SourceEntry(
        "camera:LEFT,RIGHT",
        "Two webcams",
        "Numbers as in camera:0,1 or paths below /dev/v4l/by-path; camera:sbs:0 for one camera "
        "that shows both images side by side. Below is what is plugged in.",
    ),
    SourceEntry(
        "rtsp://LEFT,rtsp://RIGHT",
        "Two network cameras",
        "Two rtsp:// or http:// addresses with a comma between them, or sbs: before one address.",
    ),
    SourceEntry(
        "FOLDER",
        "Recorded images",
        "The path of a folder on the server: left/ right/ times.txt calibration.yaml, KITTI "
        "odometry, KITTI raw or EuRoC, recognised by its content.",
    ),
    SourceEntry(
        "video:LEFT,RIGHT",
        "Two videos",
        "Paths of two video files on the server, or of one with both images side by side.",
    ),
    SourceEntry(
        "coppeliasim:HOST:PORT",
        "CoppeliaSim",
        "A simulator that runs, as in coppeliasim:127.0.0.1:23000, with the two cameras and the "
        "robots of its scene; needs the extra coppeliasim.",
    ),
)


@functools.cache
def source_entries() -> tuple[SourceEntry, ...]:
    """Return the built-in scenarios, then templates of other sources."""
    scenarios = {name: load_scenario(name) for name in scenario_names()}
    own = (SourceEntry(f"simulated:{name}", s.title, s.help) for name, s in scenarios.items())
    return (*own, *_HINTS)
