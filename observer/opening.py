"""Opening of the source that a text names and, if there is one, its ground truth.

This is the only module that knows every kind of source; the sources do not know each other.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from observer.errors import SourceError, TruthError
from observer.occupancy import OccupancyMap
from observer.robots.contract import RobotWorld
from observer.sources.contract import Source
from observer.truth.contract import Truth

if TYPE_CHECKING:
    from observer.sources.cameras.spec import CamerasSpec

SourceKind = Literal[
    "simulated", "video", "camera", "network", "coppeliasim", "recording", "folder"
]
_SCHEMES: tuple[SourceKind, ...] = ("simulated", "video", "camera", "coppeliasim")

# A scheme, even a mistyped one; a Windows drive letter is one character and stays a path.
_SCHEME = re.compile(r"^([a-z_]{2,}):", re.IGNORECASE)
# Characters: error messages quote at most this much of a refused text.
_QUOTED = 80
_NETWORK_KINDS = ("rtsp", "rtsps", "http", "https", "sbs", "sbs_swapped")


@dataclass(frozen=True, eq=False)
class OpenedSource:
    """A source and what belongs to it; the method only ever sees the source's frames.

    Attributes:
        truth: ground truth of the same world, if available.
        truth_note: why a truth file beside the images is not used.
        local_maps: recorded with the frames, by frame position.
        robots: robots that drive in the source's own world, if it has any.
        calibration_notes: decisions made while reading the source's own calibration.
    """

    source: Source
    truth: Truth | None
    robots: RobotWorld | None = None
    calibration_notes: tuple[str, ...] = ()
    truth_note: str | None = None
    local_maps: Mapping[int, OccupancyMap] = field(default_factory=dict)


def open_source(spec: str) -> OpenedSource:
    """Open what ``spec`` names.

    Args:
        spec: ``simulated:SCENARIO`` (optionally ``?seed=N``), ``video:LEFT,RIGHT`` or
            ``video:SIDE_BY_SIDE``; ``camera:0,1``, two device paths or ``camera:sbs:0`` (settings
            after ``?``); two ``rtsp://`` or ``http://`` addresses with a comma between them, or
            ``sbs:`` and one (``sbs_swapped:`` where the left image is in the right half);
            ``coppeliasim:HOST:PORT``; the path of a run's recording, ``*.mcap``; or the path of a
            folder: stereo folder, KITTI odometry, KITTI raw or EuRoC, recognised by its content.

    Raises:
        SourceError: one sentence that says what is wrong and what would be right.
        ScenarioError: the scenario is unknown or inconsistent.
    """
    try:
        return _opened(spec)
    except OSError as error:
        # For example a name that is too long, or a folder without read permission.
        raise SourceError(
            f"{shown_spec(spec)[:_QUOTED]} cannot be opened: {error.strerror or error}"
        ) from error


def _opened(spec: str) -> OpenedSource:
    if "\0" in spec:
        raise SourceError(f"a source is named without NUL characters, not {spec[:_QUOTED]!r}")
    kind, rest = _split(spec)
    if kind == "simulated":
        return _open_simulated(spec)
    if kind == "video":
        from observer.sources.video import open_video

        video = open_video(rest)
        return OpenedSource(video, None, calibration_notes=video.calibration_notes)
    if kind == "camera" or kind in _NETWORK_KINDS:
        from observer.sources.cameras.source import CameraSource

        return OpenedSource(CameraSource(_parse_cameras(spec)), None)
    if kind == "coppeliasim":
        from observer.coppeliasim.opening import open_coppeliasim

        return OpenedSource(*open_coppeliasim(rest))
    if kind:
        raise SourceError(
            f"unknown kind of source {kind!r}; use simulated:SCENARIO, video:LEFT,RIGHT, "
            f"camera:0,1, two addresses of network cameras, coppeliasim:HOST:PORT or the path of "
            f"a folder with stereo images or of a recording.mcap"
        )
    if rest.lower().endswith(".mcap"):
        return _open_recording(Path(rest))
    return _open_folder(Path(rest))


def shown_spec(spec: str) -> str:
    """Return the text that names a source, without users and passwords, for display and logs."""
    kind, rest = _split(spec)
    # A password may also follow a mistyped scheme.
    if kind not in _NETWORK_KINDS and not (kind and "//" in rest):
        return spec
    from observer.sources.cameras.spec import without_password

    try:
        return _parse_cameras(spec).text
    except SourceError:
        # It will be refused, but a possible password in any address must still be removed.
        scheme = spec.removesuffix(rest)
        with contextlib.suppress(ValueError):
            _, at, behind = rest.rpartition("@")
            return without_password(f"{scheme}//{behind}" if at else spec)
        return scheme


def live_devices(spec: str) -> tuple[str, ...]:
    """Return the names of the live cameras that ``spec`` names, as in ``SourceInfo.devices``.

    Nothing is opened; empty if ``spec`` does not name live cameras.
    """
    if _split(spec)[0] not in ("camera", *_NETWORK_KINDS):
        return ()
    try:
        return tuple(target.name for target in _parse_cameras(spec).targets)
    except SourceError:
        return ()


def source_kind(spec: str) -> SourceKind | None:
    """Return the kind of source that ``spec`` names, None if unknown. Nothing is opened."""
    kind, rest = _split(spec)
    if kind in _NETWORK_KINDS:
        return "network"
    if not kind:
        return "recording" if rest.lower().endswith(".mcap") else "folder"
    return next((each for each in _SCHEMES if each == kind), None)


def simulated_world(spec: str) -> tuple[str, int]:
    """Return the scenario, by name or path, and the seed of a simulated source.

    Raises:
        SourceError: the seed is not a number.
    """
    name, _, query = _split(spec)[1].partition("?")
    if not query:
        return name or "lab", 0
    key, _, value = query.partition("=")
    if key != "seed" or not re.fullmatch(r"[0-9]{1,18}", value):
        raise SourceError(f"a scenario takes ?seed=NUMBER, not ?{query[:_QUOTED]}")
    return name or "lab", int(value)


def exclusive_world(spec: str) -> str | None:
    """Return the world that ``spec`` names if it allows only one source; nothing is opened."""
    kind, rest = _split(spec)
    if kind != "coppeliasim":
        return None
    from observer.coppeliasim.address import parse_address

    try:
        return parse_address(rest).world
    except SourceError:
        return None


def _split(spec: str) -> tuple[str, str]:
    """Return the kind of source, empty for a path, and the text after its colon."""
    scheme = _SCHEME.match(spec)
    return (scheme.group(1).lower(), spec[scheme.end() :]) if scheme else ("", spec)


def _parse_cameras(spec: str) -> CamerasSpec:
    from observer.sources.cameras.spec import parse_devices, parse_urls

    kind, rest = _split(spec)
    return parse_devices(rest) if kind == "camera" else parse_urls(spec)


def _open_simulated(spec: str) -> OpenedSource:
    from observer.simulation.robots.world_robots import SimulatedRobots
    from observer.simulation.scenarios import load_scenario
    from observer.simulation.source import SimulatedSource
    from observer.simulation.truth import SimulatedTruth
    from observer.simulation.world import World

    name, seed = simulated_world(spec)
    world = World(load_scenario(name), seed)
    source = SimulatedSource(world)
    # Cameras must not move while a calibration board is shown to them.
    robots = None if world.board else SimulatedRobots(world, source)
    return OpenedSource(source, SimulatedTruth(world), robots)


def _open_recording(path: Path) -> OpenedSource:
    from observer.recording.local_maps import maps_by_frame
    from observer.recording.source import RecordingSource

    source = RecordingSource(path, run_clock=True)
    try:
        recording = source.recording
        return OpenedSource(source, recording.truth(), local_maps=maps_by_frame(recording))
    except BaseException:
        source.close()
        raise


def _open_folder(path: Path) -> OpenedSource:
    from observer.sources.folders import open_folder
    from observer.truth.csv_file import CsvTruth

    source = open_folder(path)
    truth: Truth | None = None
    note = None
    truth_file = path / "truth.csv"
    if truth_file.is_file():
        try:
            truth = CsvTruth(truth_file)
        except TruthError as error:
            # The images can still be observed.
            note = f"{error}; the images are processed without it"
    notes = source.calibration_notes
    return OpenedSource(source, truth, calibration_notes=notes, truth_note=note)
