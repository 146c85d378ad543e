"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.contract.parameters import ParameterValues
from observer.recording.payloads import Images

# Files beside a new run's recording: the JSON of ``frames.run_frames``, and a JSON line per frame
# (``app.workers.frame_results``), from which the server makes the run's rows.
FRAMES, SPEEDS = "frames.json", "speeds.jsonl"


@dataclass(frozen=True)
class NewRun:
    """Run to create.

    Attributes:
        folder: existing folder for its files. id, name, preset: as in ``RunFacts``.
        parameters: all parameters by dotted name, including the guard's.
        images: which images are recorded.
    """

    folder: str
    id: str
    name: str
    preset: str
    parameters: ParameterValues
    images: Images


@dataclass(frozen=True)
class CompareMethods:
    """Request to observe the same frames once for each run.

    Attributes:
        source: as ``observer.opening.open_source`` takes it.
        seconds: seconds of the source to observe. newest: take the last seconds, not the first;
            only possible for a recording.
        calibration_yaml: used instead of the source's own.
        rig_yaml: current rig; gives the camera's mount if the source does not.
        versions: software versions by name.
        picture: path for a JPEG of the newest frame with each method's result, side by side; it is
            replaced a few times a second.
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
        frames: number of frames observed. segments, begin_s, duration_s: as in ``RunRecord``;
            segments for each run.
        calibration_yaml: calibration that the frames were observed with.
        spec: spec of the source, without passwords.
    """

    frames: int
    segments: tuple[int, ...]
    begin_s: float | None
    duration_s: float | None
    calibration_yaml: str
    spec: str
