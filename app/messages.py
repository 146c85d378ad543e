"""What the web process and the engine process say to each other.

Commands are request and reply; events are ordered and numbered. Both travel as plain frozen
dataclasses; images and clouds do not travel here but through ``app.channel.latest``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal

from observer.calibration.board import Board
from observer.calibration.views import BoardView

# Views that a person can watch; each is one slot of JPEG bytes.
#   left      rectified left image, green star features, flow vectors, yellow obstacle rectangles
#   warped    the image of t+dt transformed into the frame of t
#   disparity disparity as colours, nothing where it is unknown
#   residual  residual flow as arrows and colours over the darkened image
#   plain     the rectified left image as it is (camera frustum in the 3D scene)
#   camera_left, camera_right  each image as taken; while calibrating with the board in it
CAMERA_NAMES: tuple[str, str] = ("camera_left", "camera_right")
VIEW_NAMES: tuple[str, ...] = (
    "left",
    "warped",
    "disparity",
    "residual",
    "plain",
    *CAMERA_NAMES,
)
# The view that needs dense stereo, like the cloud.
DISPARITY_NAME = "disparity"
# The slot of the dense cloud; watched like a view.
CLOUD_NAME = "cloud"


class EngineState(StrEnum):
    """What the engine does at this moment."""

    IDLE = "idle"
    PREVIEW = "preview"
    RUNNING = "running"
    CALIBRATING = "calibrating"
    FAILED = "failed"


# --- commands, web to engine ---------------------------------------------------------------


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
class OpenSource:
    """Open a source and observe it without keeping anything; ends in ``preview``.

    With ``run_id`` what is observed belongs to that run: the state becomes ``running``.
    ``segment`` is the number of the first segment, above 0 when a run goes on after a restart.
    ``calibration_yaml`` (OpenCV FileStorage text) replaces the source's own calibration.
    ``rig_yaml`` tells how the cameras are mounted where the source does not.
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
    """Use these parameters from the next frame on. The reply's value is ``{"frame": int}``:
    the first frame they act on (None without an open source)."""

    parameters: dict[str, Any]
    revision: int


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
    | SetPlayback
    | WatchViews
    | PreviewCalibration
    | MeasureDepth
    | LookAtFloor
    | TakeScenePairs
    | ExplainPixel
    | Shutdown
)


@dataclass(frozen=True)
class Request:
    """What another process is asked for; ``command`` is one of those that it knows."""

    number: int
    command: Any


@dataclass(frozen=True)
class Reply:
    """Answer to one request: a value, or one sentence of why not.

    ``refusal`` is ``input`` (what was asked is wrong), ``state`` (not possible now), ``full``
    (the disk is) or ``failure`` (it was tried and failed).
    """

    number: int
    value: dict[str, Any] | None = None
    error: str | None = None
    refusal: Literal["input", "state", "full", "failure"] | None = None


# --- events, engine to web -----------------------------------------------------------------


@dataclass(frozen=True)
class ObservationEvent:
    """One frame was observed.

    Attributes:
        sequence: counted from 0 within one engine process; a gap is a loss.
        line: the JSON line of ``observe`` (see ``observer.jsonl``), confirmed and coasting
            obstacles, each with ``why`` added: one sentence of why it counts as dynamic.
        truth: one entry per true body: id, name, role, position, velocity, speed, size, yaw,
            visible, commanded_speed, track_id (the reported obstacle it was matched to or None).
        received, published: the host's monotonic clock at reception and after observing.
        frame_skips: frames the source could not read so far.
        run_id: the run it belongs to, or None in preview.
        ego_motion: how the camera moved since the frame that this one was compared with:
            ``model, status, matches, inliers, dt`` (s), ``decomposition`` of a planar model
            (``translation_px, rotation_rad, shear, scale``) or None, and ``motion`` of the camera
            in its own axes (``rotation_rad, translation_m``, 3 each) or None. None for a frame
            that was compared with none.
        odometry: ``x, y, yaw`` by the robot's wheels (see ``observer.types.Odometry``), or None.
    """

    sequence: int
    line: dict[str, Any]
    truth: list[dict[str, Any]]
    received: float
    published: float
    frame_skips: int
    run_id: str | None
    ego_motion: dict[str, Any] | None = None
    odometry: dict[str, float] | None = None


@dataclass(frozen=True)
class StateEvent:
    """The engine's state, sent whenever any part of it changes.

    While only the playback's position moves it is sent twice a second.

    ``source`` holds the fields of ``SourceInfo``; ``playback`` holds ``paused, rate, loop,
    frame, frame_count, ended, seekable, achieved_rate`` (``frame``: position within the source,
    None before the first one; ``seekable``: whether ``SetPlayback.seek`` can be asked for;
    ``achieved_rate``: source seconds per second really played, below ``rate`` where observing
    cannot keep up, None while unknown); ``camera`` the rectified ``width, height, fx, fy, cx,
    cy, baseline``. In ``failed`` they tell of what failed.
    ``live`` holds the fields of ``LiveReport`` and ``trouble``, what keeps the source from
    delivering at this moment; None for what is not live. ``mount`` holds the fields of
    ``CameraMount`` as the observer uses it, None where it is not known. ``ageing`` holds
    ``rows`` and ``vergence``, the fields of ``RowDrift`` and ``VergenceCheck``; None before the
    first frame. ``world`` is that of ``observer.guard.sight.Sight``; ``robots`` holds the fields of
    each ``RobotPort`` that belongs to the source's own world. ``recording`` holds ``images,
    bytes, seconds, dropped, trouble``: what is kept of images, the file's size, how long it has
    been recording, how many messages were lost because the disk did not keep up, and one sentence
    of why nothing is recorded any more; None where nothing was to be recorded.
    """

    state: EngineState
    reason: str | None
    source: dict[str, Any] | None = None
    playback: dict[str, Any] | None = None
    camera: dict[str, Any] | None = None
    run_id: str | None = None
    segment: int = 0
    has_truth: bool = False
    live: dict[str, Any] | None = None
    mount: dict[str, Any] | None = None
    ageing: dict[str, Any] | None = None
    world: str | None = None
    robots: tuple[dict[str, Any], ...] = ()
    recording: dict[str, Any] | None = None


@dataclass(frozen=True)
class BoardLookEvent:
    """While calibrating: what was made of one pair; sent about ten times a second.

    Attributes:
        look: plain values: ``frame``, ``words``, ``next``, ``coverage`` by name (0 to 1), ``seen``
            (corners left and right), ``views`` (how many), ``enough``, ``automatic`` and
            ``covered`` (the side whose lens was covered since it was asked, or None).
        received: the pair, on the host's monotonic clock.
    """

    look: dict[str, Any]
    received: float


@dataclass(frozen=True)
class BoardViewsEvent:
    """While calibrating: the captured views are others.

    Attributes:
        names: of all views, in order.
        added: the new one, with a small JPEG of each image; None where one was taken away.
    """

    names: tuple[str, ...]
    added: BoardView | None = None
    pictures: tuple[bytes, bytes] | None = None


@dataclass(frozen=True)
class SkippedFrameEvent:
    """A frame that the source could not read, and why."""

    index: int
    reason: str


@dataclass(frozen=True)
class DenseStereoEvent:
    """The thread of dense stereo made the cloud or the disparity view, or failed at it.

    Attributes:
        frame, received: of the pair it was made of.
        published: the host's monotonic clock behind it.
        seconds: from taking the pair to its last slot.
        coarseness: how many pixels of the pair lie along one that was matched, each way; None
            where nothing was.
        trouble: one sentence of what failed, None where nothing did.
    """

    frame: int
    received: float
    published: float
    seconds: float
    coarseness: int | None
    trouble: str | None


@dataclass(frozen=True)
class HeartbeatEvent:
    """The engine's own loop is alive; sent at least every 100 ms, also while paused."""

    monotonic: float
    counters: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class EngineStartedEvent:
    """Made by the supervisor: a new engine process is ready. ``generation`` counts from 1."""

    generation: int
    pid: int


@dataclass(frozen=True)
class EngineLostEvent:
    """Made by the supervisor: the engine process ended or hung, and why in one sentence."""

    generation: int
    reason: str


Event = (
    ObservationEvent
    | StateEvent
    | BoardLookEvent
    | BoardViewsEvent
    | SkippedFrameEvent
    | DenseStereoEvent
    | HeartbeatEvent
    | EngineStartedEvent
    | EngineLostEvent
)
