"""Events, engine to web: ordered and numbered."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import cast

from app.contract.calibrating import BoardLook
from app.contract.live_truth import LiveTruthStatus
from app.contract.status import (
    AgeingStatus,
    EgoMotionStatus,
    LiveStatus,
    PlaybackStatus,
    RecordingStatus,
    SkippedFrame,
)
from observer.calibration.boards.board import BoardView
from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.jsonl import FrameLine, ObservationLine, ObstacleEntry
from observer.mount import CameraMount
from observer.occupancy import OccupancyMap
from observer.robots.contract import RobotPort
from observer.sources.contract import SourceInfo
from observer.truth.matching import TrueBodyEntry
from observer.types import Odometry


class EngineState(StrEnum):
    """Present state of the engine."""

    IDLE = "idle"
    PREVIEW = "preview"
    RUNNING = "running"
    CALIBRATING = "calibrating"
    FAILED = "failed"


class LiveLine(FrameLine):
    """One observation as sent to pages, without silhouettes: the views show these already."""

    obstacles: list[ObstacleEntry]


def live_line(line: ObservationLine) -> LiveLine:
    """Return an observation's JSON line without the silhouettes."""
    bare = [
        {name: value for name, value in entry.items() if name != "silhouette"}
        for entry in line["obstacles"]
    ]
    return cast(LiveLine, {**line, "obstacles": bare})


@dataclass(frozen=True)
class ObservationEvent:
    """One frame was observed.

    Attributes:
        sequence: counted from 0 within one engine process; a gap is a loss.
        line: the JSON line of ``observe`` (see ``observer.jsonl``) without silhouettes, confirmed
            and coasting obstacles, each with ``why`` added: one sentence of why it counts as
            dynamic.
        truth: one entry per true body; with live motion capture, without bodies that were not
            measured, and empty until it is aligned.
        received, published: the host's monotonic clock at reception and after observing.
        frame_skips: frames the source could not read so far.
        run_id: the run it belongs to, or None in preview.
        ego_motion: None for a frame that was not compared with another.
        odometry: from the robot's wheels, if it reports any.
    """

    sequence: int
    line: LiveLine
    truth: list[TrueBodyEntry]
    received: float
    published: float
    frame_skips: int
    run_id: str | None
    ego_motion: EgoMotionStatus | None = None
    odometry: Odometry | None = None


@dataclass(frozen=True)
class StateEvent:
    """The engine's state, sent whenever any part of it changes.

    While only the playback position changes, it is sent twice a second.

    In ``failed``, all other fields describe what failed.

    Attributes:
        camera: the rectified pair. mount: as the observer uses it, None where it is not known.
        ageing: None before the first frame. live: None if the source is not live.
        world: that of ``observer.guard.sight.Sight``. robots: those of the source's own world.
        recording: None if nothing was to be recorded. truth: live motion capture, None if there
            is none to listen to.
        calibration_notes: choices made while the source's own calibration was read; empty if
            another one is used.
        truth_note: why a file next to the source's images is not used as ground truth.
        preparing: while no source is open, why it takes a while until one can be observed.
        troubles: what cannot be drawn or checked at the moment, though observing goes on.
    """

    state: EngineState
    reason: str | None
    source: SourceInfo | None = None
    playback: PlaybackStatus | None = None
    camera: StereoCamera | None = None
    run_id: str | None = None
    segment: int = 0
    has_truth: bool = False
    live: LiveStatus | None = None
    mount: CameraMount | None = None
    ageing: AgeingStatus | None = None
    world: str | None = None
    robots: tuple[RobotPort, ...] = ()
    recording: RecordingStatus | None = None
    truth: LiveTruthStatus | None = None
    calibration_notes: tuple[str, ...] = ()
    truth_note: str | None = None
    preparing: str | None = None
    troubles: tuple[str, ...] = ()


@dataclass(frozen=True)
class BoardLookEvent:
    """While calibrating: the board as seen in one pair; sent about ten times a second.

    ``received``: the pair, on the host's monotonic clock.
    """

    look: BoardLook
    received: float


@dataclass(frozen=True)
class BoardViewsEvent:
    """While calibrating: the captured views have changed.

    Attributes:
        names: of all views, in order.
        added: the new one, with a small JPEG of each image; None if one was removed.
    """

    names: tuple[str, ...]
    added: BoardView | None = None
    pictures: tuple[bytes, bytes] | None = None


@dataclass(frozen=True)
class SkippedFrameEvent(SkippedFrame):
    """A frame that the source could not read, and why."""


@dataclass(frozen=True)
class DenseStereoEvent:
    """The dense-stereo thread made the cloud or the disparity view, or failed to.

    Attributes:
        frame, received: of the pair it was made from.
        published: the host's monotonic clock afterwards.
        seconds: from taking the pair to writing the last slot.
        coarseness: downscaling factor of the pair for matching, along each axis; None if nothing
            was matched.
        trouble: one sentence on what failed, None if nothing did.
    """

    frame: int
    received: float
    published: float
    seconds: float
    coarseness: int | None
    trouble: str | None


@dataclass(frozen=True)
class LocalMapEvent:
    """The observer's local map has changed; sent at most a few times a second.

    Attributes:
        map: used to plan the path to a goal, now or when it was recorded; None: there is none.
        T_world_corner: as ``OccupancyMap.placed`` has it, in the world of the newest observation.
    """

    map: OccupancyMap | None
    T_world_corner: Pose | None


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
    | LocalMapEvent
    | HeartbeatEvent
    | EngineStartedEvent
    | EngineLostEvent
)
