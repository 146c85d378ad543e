"""Commands, web to engine: request and reply."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from app.contract.answers import CalibrationPreview, FloorPoints, KeptClip, Opened, ScenePairs
from app.contract.calibrating import PlaceDepth
from app.contract.live_truth import LiveTruthStatus
from app.contract.pixel import Pixel
from app.contract.status import PlaybackStatus, RecordingStatus
from observer.calibration.board import Board, BoardView
from observer.recording.payloads import Images, Incident, RobotRow

# How much faster or slower than its recorded pace a source can be played.
MIN_PLAYBACK_RATE = 0.1
MAX_PLAYBACK_RATE = 4.0
Answer = TypeVar("Answer")


class ToEngine(Generic[Answer]):
    """A command to the engine, and what its reply's value is."""


@dataclass(frozen=True)
class RecordOrder:
    """Order to record a run.

    Attributes:
        path: of the file; one that is there already is gone on with where the run goes on.
        images: which are kept. name: of the run. preset: what its parameters began as.
        versions: of packages, by name.
        reserve_bytes: the recording ends before less than this is left on the disk.
    """

    path: str
    images: Images
    name: str
    preset: str | None = None
    versions: dict[str, str] = field(default_factory=dict)
    reserve_bytes: int = 200 << 20


@dataclass(frozen=True)
class LiveTruthOrder:
    """Live motion capture that what is observed is compared with.

    Attributes:
        spec: as for ``observer.truth.live.opening.open_live_truth``.
        observer: the body that carries the camera, None where it is to be found out.
        ignore: bodies that are neither observer nor obstacle.
    """

    spec: str
    observer: str | None = None
    ignore: tuple[str, ...] = ()


@dataclass(frozen=True)
class OpenSource(ToEngine[Opened]):
    """Open a source and observe it without keeping anything; ends in ``preview``.

    With ``run_id`` what is observed belongs to that run: the state becomes ``running``.
    ``segment`` is the number of the first segment, above 0 when a run goes on after a restart.
    ``calibration_yaml`` (OpenCV FileStorage text) replaces the source's own calibration.
    ``rig_yaml`` tells how the cameras are mounted where the source does not.
    ``truth`` is listened to from now on; what was listened to already goes on.
    With ``record`` the run is recorded; where that cannot begin, the source is refused, except
    where the run goes on: then it goes on without.
    Refused, what was open before stays open.
    """

    source: str
    calibration_yaml: str | None
    parameters: dict[str, Any]
    parameters_revision: int
    loop: bool = True
    paused: bool = False
    rate: float = 1.0
    run_id: str | None = None
    segment: int = 0
    rig_yaml: str | None = None
    record: RecordOrder | None = None
    truth: LiveTruthOrder | None = None


@dataclass(frozen=True)
class BeginCalibration(ToEngine[Opened]):
    """Open a source, show its images as taken and look for a board; ends in ``calibrating``.

    ``views`` were captured before and go on counting. Refused, what was open before stays open.
    """

    source: str
    board: Board
    views: tuple[BoardView, ...] = ()
    automatic: bool = True


@dataclass(frozen=True)
class ChangeCalibration(ToEngine[tuple[str, ...]]):
    """Change what is given, while calibrating.

    ``capture`` keeps the board as it is seen at this moment, ``undo`` forgets the last view,
    ``remove`` one by its name. ``automatic``: whether a new pose is captured by itself.
    ``cover_check`` begins (True) or ends the question which camera is the left one. Answered by
    the views' names.
    """

    capture: bool = False
    undo: bool = False
    remove: str | None = None
    automatic: bool | None = None
    cover_check: bool | None = None


@dataclass(frozen=True)
class StopRun(ToEngine[RecordingStatus | None]):
    """End the run; the source stays open in ``preview``.

    A recording is whole when the reply comes.
    """


@dataclass(frozen=True)
class SaveClip(ToEngine[KeptClip]):
    """Write the last half minute, as a recording of its own, to ``path``.

    It is kept in a run that is recorded, and of live sources always.
    """

    path: str
    reserve_bytes: int = 200 << 20


@dataclass(frozen=True)
class RecordRobots(ToEngine[None]):
    """Rows on robots since the last time, for the run's recording; none is no error."""

    rows: tuple[RobotRow, ...] = ()
    incidents: tuple[Incident, ...] = ()


@dataclass(frozen=True)
class CloseSource(ToEngine[None]):
    """Close the source; the state becomes ``idle``."""


@dataclass(frozen=True)
class SetParameters(ToEngine[int | None]):
    """Use these parameters, the guard's among them, from the next frame on; the revision of before
    leaves the observer alone. Answered by the first frame they act on, None without an open
    source."""

    parameters: dict[str, Any]
    revision: int


@dataclass(frozen=True)
class SetTruth(ToEngine[LiveTruthStatus | None]):
    """Listen to this live motion capture from now on, None to none; the source stays open."""

    truth: LiveTruthOrder | None


@dataclass(frozen=True)
class SetPlayback(ToEngine[PlaybackStatus]):
    """Change what is given; ``step`` shows that many further frames while paused.

    ``seek`` goes on with that frame, from 0, of a recording, and shows it also while paused; it
    begins a new segment.
    """

    paused: bool | None = None
    rate: float | None = None
    loop: bool | None = None
    step: int = 0
    restart: bool = False
    seek: int | None = None


@dataclass(frozen=True)
class WatchViews(ToEngine[None]):
    """The views (``VIEW_NAMES`` and ``CLOUD_NAME``) somebody watches now; only these are made."""

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
    """The newest pair's points by which the floor is found."""


@dataclass(frozen=True)
class TakeScenePairs(ToEngine[ScenePairs]):
    """Pairs of the last half minute, by which the rows can be set straight, and the vergence."""


@dataclass(frozen=True)
class ExplainPixel(ToEngine[Pixel]):
    """Say why a pixel of the newest observed frame counts as moving, standing or neither.

    ``u``, ``v`` are in the rectified left image.
    """

    u: float
    v: float


@dataclass(frozen=True)
class Shutdown(ToEngine[None]):
    """Close the source and leave."""
