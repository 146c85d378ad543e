"""Suggestions for sources to open."""

from __future__ import annotations

import functools

from observer.simulation.scenarios import load_scenario, scenario_names

_HINTS = (
    (
        "camera:LEFT,RIGHT",
        "Two webcams",
        "Numbers as in camera:0,1 or paths below /dev/v4l/by-path; camera:sbs:0 for one camera "
        "that shows both images side by side. Below is what is plugged in.",
    ),
    (
        "rtsp://LEFT,rtsp://RIGHT",
        "Two network cameras",
        "Two rtsp:// or http:// addresses with a comma between them, or sbs: before one address.",
    ),
    (
        "FOLDER",
        "Recorded images",
        "The path of a folder on the server: left/ right/ times.txt calibration.yaml, KITTI "
        "odometry, KITTI raw or EuRoC, recognised by its content.",
    ),
    (
        "video:LEFT,RIGHT",
        "Two videos",
        "Paths of two video files on the server, or of one with both images side by side.",
    ),
    (
        "coppeliasim:HOST:PORT",
        "CoppeliaSim",
        "A simulator that runs, as in coppeliasim:127.0.0.1:23000, with the two cameras and the "
        "robots of its scene; needs the extra coppeliasim.",
    ),
)


@functools.cache
def source_entries() -> tuple[dict[str, str], ...]:
    """Return the built-in scenarios, then templates of other sources: ``spec, title, help``."""
    scenarios = []
    for name in scenario_names():
        scenario = load_scenario(name)
        spec = f"simulated:{name}"
        scenarios.append({"spec": spec, "title": scenario.title, "help": scenario.help})
    return (*scenarios, *({"spec": s, "title": t, "help": h} for s, t, h in _HINTS))
