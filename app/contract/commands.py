"""Commands, web to engine: request and reply."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

from app.contract.answers import CalibrationPreview, FloorPoints, KeptClip, Opened, ScenePairs
from app.contract.calibrating import PlaceDepth
from app.contract.live_truth import LiveTruthStatus
from app.contract.parameters import ParameterValues
from app.contract.pixel import Pixel
from app.contract.status import PlaybackStatus, RecordingStatus
from observer.calibration.boards.board import Board, BoardView
from observer.recording.payloads import Images, Incident, RobotRow

# Limits of the playback rate, relative to the recorded pace.
MIN_PLAYBACK_RATE = 0.1
MAX_PLAYBACK_RATE = 4.0
Answer = TypeVar("Answer")


class ToEngine(Generic[Answer]):
    """Command to the engine; ``Answer`` is the type of its reply's value."""


@dataclass(frozen=True)
class RecordOrder:
    """Order to record a run.

    Attributes:
        path: of the file; an existing one is continued if the run is.
        images: which are kept. name: of the run. preset: of its parameters at the start.
        versions: of packages, by name.
        reserve_bytes: the recording ends before the free disk space falls below this.
    """

    path: str
    images: Images
    name: str
    preset: str | None = None
    versions: dict[str, str] = field(default_factory=dict)
    reserve_bytes: int = 200 << 20


@dataclass(frozen=True)
class LiveTruthOrder:
    """Live motion capture to compare the observations with.

    Attributes:
        spec: as for ``observer.truth.live.opening.open_live_truth``.
        observer: the body that carries the camera, None to detect it.
        ignore: bodies that are neither observer nor obstacle.
    """

    spec: str
    observer: str | None = None
    ignore: tuple[str, ...] = ()


@dataclass(frozen=True)
class OpenSource(ToEngine[Opened]):
    """Open a source and observe it without keeping anything; ends in ``preview``.

    With ``run_id`` the observations belong to that run: the state becomes ``running``.
    ``segment`` is the number of the first segment, above 0 when a run continues after a restart.
    ``calibration_yaml`` (OpenCV FileStorage text) replaces the source's own calibration.
    ``rig_yaml`` gives the mount of the cameras if the source does not.
    ``truth`` is listened to from now on; an existing connection to it is kept.
    With ``record`` the run is recorded; if recording cannot begin, the source is refused, unless
    the run is being continued: then it continues without a recording.
    ``opening`` is the number by which ``CancelOpening`` names it.
    If refused, the source that was open before stays open.
    """

    source: str
    calibration_yaml: str | None
    parameters: ParameterValues
    parameters_revision: int
    loop: bool = True
    paused: bool = False
    rate: float = 1.0
    run_id: str | None = None
    segment: int = 0
    rig_yaml: str | None = None
    record: RecordOrder | None = None
    truth: LiveTruthOrder | None = None
    opening: int = 0


@dataclass(frozen=True)
class BeginCalibration(ToEngine[Opened]):
    """Open a source, show its images as taken and look for a board; ends in ``calibrating``.

    ``views`` were captured before and still count. ``opening`` is the number by which
    ``CancelOpening`` names it. If refused, the source that was open before stays open.
    """

    source: str
    board: Board
    views: tuple[BoardView, ...] = ()
    automatic: bool = True
    opening: int = 0


@dataclass(frozen=True)
class CancelOpening(ToEngine[None]):
    """Give up the opening of this number, even if it has just succeeded; leave any other alone.

    It records nothing and keeps no source open. ``reason`` says why, in words that follow
    "because".
    """

    opening: int
    reason: str


@dataclass(frozen=True)
class ChangeCalibration(ToEngine[tuple[str, ...]]):
    """Apply the given changes to the calibration in progress.

    ``capture`` captures the board as seen at this moment, ``undo`` drops the last view, ``remove``
    one by its name. ``automatic``: whether new poses are captured automatically. ``cover_check``
    starts (True) or ends the check of which camera is the left one. The answer is the views' names.
    """

    capture: bool = False
    undo: bool = False
    remove: str | None = None
    automatic: bool | None = None
    cover_check: bool | None = None


@dataclass(frozen=True)
class StopRun(ToEngine[RecordingStatus | None]):
    """End the run; the source stays open in ``preview``.

    A recording is complete when the reply arrives.
    """


@dataclass(frozen=True)
class SaveClip(ToEngine[KeptClip]):
    """Write the last half minute, as a recording of its own, to ``path``.

    The last half minute is buffered during a recorded run, and for live sources always.
    """

    path: str
    reserve_bytes: int = 200 << 20


@dataclass(frozen=True)
class RecordRobots(ToEngine[None]):
    """Add robots' rows since the last time to the run's recording, if there is one."""

    rows: tuple[RobotRow, ...] = ()
    incidents: tuple[Incident, ...] = ()


@dataclass(frozen=True)
class CloseSource(ToEngine[None]):
    """Close the source; the state becomes ``idle``."""


@dataclass(frozen=True)
class SetParameters(ToEngine[int | None]):
    """Use these parameters, including the guard's, from the next frame on; an unchanged revision
    leaves the observer as it is. The answer is the first frame they apply to, None without an open
    source."""

    parameters: ParameterValues
    revision: int


@dataclass(frozen=True)
class SetTruth(ToEngine[LiveTruthStatus | None]):
    """Listen to this live motion capture from now on (None: to none); the source stays open."""

    truth: LiveTruthOrder | None


@dataclass(frozen=True)
class SetPlayback(ToEngine[PlaybackStatus]):
    """Change the given settings; ``step`` shows that many further frames while paused.

    ``seek`` continues from that frame of a recording, counted from 0, and shows it even while
    paused; it begins a new segment.
    """

    paused: bool | None = None
    rate: float | None = None
    loop: bool | None = None
    step: int = 0
    restart: bool = False
    seek: int | None = None


@dataclass(frozen=True)
class WatchViews(ToEngine[None]):
    """Views (``VIEW_NAMES`` and ``CLOUD_NAME``) being watched; only these are rendered."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class PreviewCalibration(ToEngine[CalibrationPreview]):
    """Rectify the newest raw pair with this calibration and draw epipolar lines over both."""

    calibration_yaml: str


@dataclass(frozen=True)
class MeasureDepth(ToEngine[PlaceDepth]):
    """Measure how far away a pixel of the newest pair is, rectified with this calibration."""

    calibration_yaml: str
    u: float
    v: float


@dataclass(frozen=True)
class LookAtFloor(ToEngine[FloorPoints]):
    """Return the newest pair's points for estimating the floor."""


@dataclass(frozen=True)
class TakeScenePairs(ToEngine[ScenePairs]):
    """Return pairs of the last half minute for refining the row alignment, and the vergence."""


@dataclass(frozen=True)
class ExplainPixel(ToEngine[Pixel]):
    """Say why a pixel of the newest observed frame counts as moving, static or neither.

    ``u``, ``v`` are in the rectified left image.
    """

    u: float
    v: float


@dataclass(frozen=True)
class Shutdown(ToEngine[None]):
    """Close the source and leave."""
