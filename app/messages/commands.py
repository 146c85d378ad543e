"""Commands, web to engine: request and reply."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from observer.calibration.board import Board
from observer.calibration.views import BoardView

# How much faster or slower than its recorded pace a source can be played.
MIN_PLAYBACK_RATE = 0.1
MAX_PLAYBACK_RATE = 4.0


@dataclass(frozen=True)
class RecordOrder:
    """Where and how a run is recorded.

    Attributes:
        path: of the file; one that is there already is gone on with where the run goes on.
        images: which are kept. name: of the run. preset: what its parameters began as.
        versions: of packages, by name.
        reserve_bytes: the recording ends before less than this is left on the disk.
    """

    path: str
    images: Literal["none", "jpeg", "lossless"]
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
class OpenSource:
    """Open a source and observe it without keeping anything; ends in ``preview``.

    With ``run_id`` what is observed belongs to that run: the state becomes ``running``.
    ``segment`` is the number of the first segment, above 0 when a run goes on after a restart.
    ``calibration_yaml`` (OpenCV FileStorage text) replaces the source's own calibration.
    ``rig_yaml`` tells how the cameras are mounted where the source does not.
    ``truth`` is listened to from now on; what was listened to already goes on.
    With ``record`` the run is recorded; where that cannot begin, the source is refused, except
    where the run goes on: then it goes on without.
    The reply's value has the fields of the ``StateEvent`` that goes before it, and
    ``calibration_yaml``: the calibration that is used, also where it is the source's own.
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
class BeginCalibration:
    """Open a source, show its images as taken and look for a board; ends in ``calibrating``.

    ``views`` were captured before and go on counting. The reply's value has the fields of the
    ``StateEvent`` that goes before it. Refused, what was open before stays open.
    """

    source: str
    board: Board
    views: tuple[BoardView, ...] = ()
    automatic: bool = True


@dataclass(frozen=True)
class ChangeCalibration:
    """Change what is given, while calibrating.

    ``capture`` keeps the board as it is seen at this moment, ``undo`` forgets the last view,
    ``remove`` one by its name. ``automatic``: whether a new pose is captured by itself.
    ``cover_check`` begins (True) or ends the question which camera is the left one. The reply's
    value is ``{"views": [names]}``.
    """

    capture: bool = False
    undo: bool = False
    remove: str | None = None
    automatic: bool | None = None
    cover_check: bool | None = None


@dataclass(frozen=True)
class StopRun:
    """End the run; the source stays open in ``preview``.

    A recording is whole when the reply comes; its value is ``{"recording": facts}``, as in
    ``StateEvent.recording``.
    """


@dataclass(frozen=True)
class SaveRing:
    """Write the last half minute, as a recording of its own, to ``path``.

    It is kept in a run that is recorded, and of live sources always. The reply's value is
    ``{"bytes", "seconds"}``: of the file, and how far back it reaches.
    """

    path: str
    reserve_bytes: int = 200 << 20


@dataclass(frozen=True)
class RecordRobots:
    """What was heard of robots since the last time, for the run's recording; none is no error.

    Attributes:
        rows: fields of ``observer.recording.payloads.RobotRow``.
        incidents: fields of ``observer.recording.payloads.Incident``.
    """

    rows: tuple[dict[str, Any], ...] = ()
    incidents: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True)
class CloseSource:
    """Close the source; the state becomes ``idle``."""


@dataclass(frozen=True)
class SetParameters:
    """Use these parameters, the guard's among them, from the next frame on; the revision of before
    leaves the observer alone. The reply's value is ``{"frame": int}``: the first frame they act on
    (None without an open source)."""

    parameters: dict[str, Any]
    revision: int


@dataclass(frozen=True)
class SetTruth:
    """Listen to this live motion capture from now on, None to none; the source stays open.

    The reply's value is ``{"truth": facts}``, as in ``StateEvent.truth``.
    """

    truth: LiveTruthOrder | None


@dataclass(frozen=True)
class SetPlayback:
    """Change what is given; ``step`` shows that many further frames while paused.

    ``seek`` goes on with that frame, from 0, of a recording, and shows it also while paused; it
    begins a new segment.

    The reply's value is the playback as in ``StateEvent.playback``.
    """

    paused: bool | None = None
    rate: float | None = None
    loop: bool | None = None
    step: int = 0
    restart: bool = False
    seek: int | None = None


@dataclass(frozen=True)
class WatchViews:
    """The views (``VIEW_NAMES`` and ``CLOUD_NAME``) somebody watches now; only these are made."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class PreviewCalibration:
    """Rectify the newest raw pair with this calibration and draw epipolar lines over both.

    The reply's value is ``{"jpeg": bytes, "vertical_error_px": float | None, "matches": int}``.
    """

    calibration_yaml: str


@dataclass(frozen=True)
class MeasureDepth:
    """How far away a pixel of the newest pair is, rectified with this calibration.

    The reply's value is that of ``app.engine.depth_measuring.measure_depth``.
    """

    calibration_yaml: str
    u: float
    v: float


@dataclass(frozen=True)
class LookAtFloor:
    """The newest pair's points by which the floor is found.

    The reply's value is that of ``app.engine.floor_looking.look_at_floor``.
    """


@dataclass(frozen=True)
class TakeScenePairs:
    """Pairs of the last half minute, by which the rows can be set straight.

    The reply's value is ``{"pairs": ((left, right), ...), "calibration_yaml": str}``: images as
    taken, (H, W) grey, and the calibration in use.
    """


@dataclass(frozen=True)
class ExplainPixel:
    """Say why a pixel of the newest observed frame counts as moving, standing or neither.

    ``u``, ``v`` are in the rectified left image. The reply's value is ``{"frame": int,
    "segment": int, "u", "v", "verdict", "sentence", "numbers": {name: float | None},
    "would_change"}`` as in ``observer.explanation.PixelAnswer``, and ``"obstacle"``: ``{"id",
    "reported", "why"}`` of the obstacle at a dynamic pixel, or None.
    """

    u: float
    v: float


@dataclass(frozen=True)
class Shutdown:
    """Close the source and leave."""


Command = (
    OpenSource
    | BeginCalibration
    | ChangeCalibration
    | StopRun
    | SaveRing
    | RecordRobots
    | CloseSource
    | SetParameters
    | SetTruth
    | SetPlayback
    | WatchViews
    | PreviewCalibration
    | MeasureDepth
    | LookAtFloor
    | TakeScenePairs
    | ExplainPixel
    | Shutdown
)
