"""Events, engine to web: ordered and numbered."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from observer.calibration.views import BoardView


class EngineState(StrEnum):
    """What the engine does at this moment."""

    IDLE = "idle"
    PREVIEW = "preview"
    RUNNING = "running"
    CALIBRATING = "calibrating"
    FAILED = "failed"


@dataclass(frozen=True)
class ObservationEvent:
    """One frame was observed.

    Attributes:
        sequence: counted from 0 within one engine process; a gap is a loss.
        line: the JSON line of ``observe`` (see ``observer.jsonl``), confirmed and coasting
            obstacles, each with ``why`` added: one sentence of why it counts as dynamic.
        truth: one entry per true body: id, name, role, position, velocity, speed, size, yaw,
            visible, commanded_speed, track_id (the reported obstacle it was matched to or None).
            By live motion capture also ``time``, the instant on the source's clock at which it was
            measured, up to 0.1 s before the frame; what was not measured is left out, and all of
            it as long as nothing is aligned.
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
    ``truth`` tells of live motion capture, None where none is listened to: ``spec``, ``observer``
    and ``ignore`` as ordered; ``state`` (``connecting, receiving, waiting``), ``trouble`` and
    ``notes`` of the connection; ``bodies``: each ``name``, ``role`` (``observer``, ``obstacle`` or
    None) and ``rate_hz``; ``clock``: ``offset_s, drift_ppm, sigma_s, samples`` of the server's
    against the host's, or None; ``aligned`` and ``sentence``: whether it is aligned with what is
    observed, and how or why not; ``alignment``: ``offset_s, sigma_s, drift_ppm, correlation,
    overlap_s, residual_mps, samples, observer, frame_residual_m, matches, notes``, or None.
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
    truth: dict[str, Any] | None = None


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
