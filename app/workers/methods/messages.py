"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from observer.recording.payloads import Images

# Files beside a new run's recording: the JSON of ``frames.run_frames``; and for each frame a line
# of JSON, ``line`` and ``truth``, from which the server makes the run's rows.
FRAMES, SPEEDS = "frames.json", "speeds.jsonl"


@dataclass(frozen=True)
class NewRun:
    """A run to make.

    Attributes:
        folder: for its files; it exists. id, name, preset: as in ``RunFacts``.
        parameters: all, by dotted name, the guard's too.
        images: which are recorded.
    """

    folder: str
    id: str
    name: str
    preset: str
    parameters: Mapping[str, Any]
    images: Images


@dataclass(frozen=True)
class CompareMethods:
    """Request to observe the same frames once for each run.

    Attributes:
        source: as ``observer.opening.open_source`` takes it.
        seconds: of the source to observe. newest: its last ones, else its first ones; only a
            recording has last ones.
        calibration_yaml: used instead of the source's own.
        rig_yaml: in force; tells the camera's mount where the source does not.
        versions: of the software, by name.
        picture: path for a JPEG of the newest frame with what each method found, side by side; it
            is replaced a few times a second.
    """

    source: str
    seconds: float
    newest: bool
    calibration_yaml: str | None
    rig_yaml: str | None
    versions: Mapping[str, str]
    picture: str
    runs: tuple[NewRun, ...]


@dataclass(frozen=True)
class Compared:
    """End of a comparison.

    Attributes:
        frames: observed. segments, begin_s, duration_s: of the runs, as in ``RunRecord``.
        calibration_yaml: that they were observed with.
        spec: of the source, without passwords.
    """

    frames: int
    segments: tuple[int, ...]
    begin_s: float | None
    duration_s: float | None
    calibration_yaml: str
    spec: str
