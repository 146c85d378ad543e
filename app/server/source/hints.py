"""Sources to choose from: recently opened ones, built-in ones, and templates for others."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from app.contract.calibrating import BoardFacts
from app.contract.sources import SourceEntry, SourceGroup
from app.contract.values import filled
from app.server.source.chosen_source import RUN
from observer.opening import SourceKind, shown_spec, source_kind
from observer.simulation.scenarios import load_scenario, scenario_names

# Scenarios for new users, listed first in this order; the others follow by name.
_FIRST = ("lab", "people", "drive", "calibration", "webcams", "crossing", "parked_beside_moving")
_GROUPS: Mapping[SourceKind, SourceGroup] = {
    "simulated": "simulated",
    "coppeliasim": "simulated",
    "camera": "cameras",
    "network": "cameras",
    "recording": "recordings",
    "folder": "folders",
    "video": "folders",
}
_PICTURED: tuple[SourceKind, ...] = ("simulated", "folder")
_TITLES: Mapping[SourceKind, str] = {
    "camera": "Cameras of this server",
    "network": "Network cameras",
    "coppeliasim": "CoppeliaSim",
}
_TEMPLATES = (
    SourceEntry(
        "coppeliasim:HOST:PORT",
        "CoppeliaSim",
        "A running simulator, for example coppeliasim:127.0.0.1:23000, with the cameras and robots "
        "of its scene. Needs the extra coppeliasim.",
        "simulated",
        template=True,
    ),
    SourceEntry(
        "camera:LEFT,RIGHT",
        "Two webcams",
        "Numbers, as in camera:0,1, or paths below /dev/v4l/by-path. camera:sbs:0 is one camera "
        "that delivers both images side by side.",
        "cameras",
        template=True,
    ),
    SourceEntry(
        "rtsp://LEFT,rtsp://RIGHT",
        "Two network cameras",
        "Two rtsp:// or http:// addresses separated by a comma, or sbs: before one address.",
        "cameras",
        template=True,
    ),
    SourceEntry(
        "RECORDING.mcap",
        "Another recording",
        "The path on the server of a run's recording.mcap.",
        "recordings",
        template=True,
    ),
    SourceEntry(
        "FOLDER",
        "A folder of images",
        "The path on the server of a folder with left/, right/, times.txt and calibration.yaml, or "
        "of KITTI odometry, KITTI raw or EuRoC data; the layout is recognised.",
        "folders",
        template=True,
    ),
    SourceEntry(
        "video:LEFT,RIGHT",
        "Two videos",
        "The paths on the server of two video files, or of one with both images side by side.",
        "folders",
        template=True,
    ),
)


def source_entries(
    recent: Sequence[str] = (), names: Mapping[str, str] | None = None
) -> tuple[SourceEntry, ...]:
    """Return the recently opened sources that are not built in, the scenarios, and the templates.

    Args:
        recent: specs of opened sources, the last one first.
        names: display names of some of them, by spec.
    """
    names = names or {}
    places = {spec: k for k, spec in enumerate(recent)}
    known = {entry.spec for entry in _scenarios()}
    opened = [_entry(spec, names.get(spec)) for spec in recent if spec not in known]
    every = (*(each for each in opened if each is not None), *_scenarios(), *_TEMPLATES)
    return tuple(replace(entry, recent=places.get(entry.spec)) for entry in every)


def source_title(spec: str) -> str:
    """Return the display name of a source, as on its tile: "The lab", or a folder's own name."""
    entry = _entry(spec, None)
    return shown_spec(spec) if entry is None else entry.title


@functools.cache
def _scenarios() -> tuple[SourceEntry, ...]:
    names = (*_FIRST, *(name for name in scenario_names() if name not in _FIRST))
    return tuple(_scenario(f"simulated:{name}", name) for name in names)


def _scenario(spec: str, name: str, addition: str = "") -> SourceEntry:
    scenario = load_scenario(name)
    return SourceEntry(
        spec,
        f"{scenario.title}{addition}",
        scenario.help,
        "simulated",
        picture=True,
        board=None
        if scenario.board is None
        else filled(BoardFacts, scenario.board.board, square_mm=scenario.board.square_mm),
    )


@functools.lru_cache(maxsize=16)
def is_for_calibrating(spec: str) -> bool:
    """Return whether a source is a scenario made for calibrating, with the board it shows."""
    name = _built_in(spec)
    if name is None:
        return False
    scenario = load_scenario(name)
    return scenario.board is not None and not scenario.hands_out_calibration


def _built_in(spec: str) -> str | None:
    """Return the name of the built-in scenario that a spec names; None for any other source."""
    name = spec.partition(":")[2].partition("?")[0]
    return name if source_kind(spec) == "simulated" and name in scenario_names() else None


def _entry(spec: str, name: str | None) -> SourceEntry | None:
    """Return the entry of a recently opened source; None if its kind no longer exists."""
    kind: SourceKind | None = "recording" if spec.startswith(RUN) else source_kind(spec)
    if kind is None:
        return None
    scenario = _built_in(spec)
    if scenario is not None:
        query = spec.partition("?")[2]
        return _scenario(spec, scenario, f", {query.replace('=', ' ')}" if query else "")
    last = Path(spec.partition(":")[2] if kind == "video" else spec).name
    title = name or _TITLES.get(kind) or last or spec
    return SourceEntry(spec, title, spec, _GROUPS[kind], picture=kind in _PICTURED)
