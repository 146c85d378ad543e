"""Our own messages of a recording: plain values as JSON, with their schemas.

All numbers are in SI units. ``time`` is on the source's clock, ``received`` on the host's monotonic
one; both are meaningful only within one recording. Null means unknown.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Literal

import msgspec

from observer.errors import SourceError
from observer.mount import CameraMount
from observer.occupancy import OccupancyMap
from observer.types import Odometry

Images = Literal["none", "jpeg", "lossless"]
# ``observer``: a new observer begins at this frame; ``segment``: the same one begins a new world.
Begins = Literal["observer", "segment"]


class Anchor(msgspec.Struct, frozen=True):
    """One instant on two clocks: the only time at which a recording reads the wall clock.

    Attributes:
        wall_ns: nanoseconds since 1970, UTC. monotonic: the host's monotonic clock, seconds.
    """

    wall_ns: int
    monotonic: float

    @staticmethod
    def now() -> Anchor:
        """Read both clocks."""
        return Anchor(time.time_ns(), time.monotonic())

    def wall_time_ns(self, monotonic: float) -> int:
        """Convert an instant of the monotonic clock to nanoseconds since 1970, without jumps."""
        return max(0, self.wall_ns + round((monotonic - self.monotonic) * 1e9))


class RunFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Facts known when a run begins, including everything that a re-run needs.

    Attributes:
        id, name: of the run. source: the spec by which it was opened, without passwords.
        info: the fields of the source's ``SourceInfo``.
        calibration_yaml: OpenCV FileStorage text, as used. rig_yaml: as used, or None.
        mount: fields of the ``CameraMount`` that the observer was created with, or None.
        preset: name of the preset that the run began with, or None.
        segment: number of the first segment. versions: of packages, by name.
        images: how images are recorded. anchor: of all log times.
        notes: further facts in words, by name.
    """

    id: str
    name: str
    source: str
    info: dict[str, Any]
    calibration_yaml: str
    images: Images = "jpeg"
    rig_yaml: str | None = None
    mount: dict[str, float | None] | None = None
    preset: str | None = None
    segment: int = 0
    versions: dict[str, str] = {}
    notes: dict[str, str] = {}
    anchor: Anchor = msgspec.field(default_factory=Anchor.now)

    def camera_mount(self) -> CameraMount | None:
        """Return the mount that the run was observed with.

        Raises:
            SourceError: the recorded mount is invalid.
        """
        if self.mount is None:
            return None
        known: dict[str, Any] = {name: v for name, v in self.mount.items() if v is not None}
        try:
            return CameraMount(**known)
        except (TypeError, ValueError):
            raise SourceError(
                "the recording is damaged: the camera mount has an unexpected format; give an "
                "intact recording"
            ) from None


class RecordedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """One frame as it was observed.

    Attributes:
        index, time, right_time, received, odometry: of the ``StereoFrame``.
        source_position, source_time: of the frame within its source; they repeat if the source
            is played in a loop.
        image: number of its images within the recording; None if none are recorded.
        begins: what begins at this frame, or None.
    """

    index: int
    time: float
    received: float
    right_time: float | None = None
    odometry: Odometry | None = None
    source_position: int | None = None
    source_time: float | None = None
    image: int | None = None
    begins: Begins | None = None


class ParameterRevision(msgspec.Struct, frozen=True, kw_only=True):
    """Parameters that apply from the next recorded frame on.

    Attributes:
        revision: incremented with every change of the parameters of observing. frame: index of the
            first frame they apply to, or None if nothing was observed yet.
        values: all, by dotted name; including the guard's if recorded by a server.
        difference: those that changed.
    """

    revision: int
    values: dict[str, Any]
    frame: int | None = None
    difference: dict[str, Any] = {}


class EgoMotionPayload(msgspec.Struct, frozen=True, kw_only=True):
    """Motion of the camera, as in the engine's events: plain values by name."""

    frame: int
    time: float
    values: dict[str, Any]


class BodyPayload(msgspec.Struct, frozen=True, kw_only=True):
    """``TrueBody``, in the truth's own world."""

    id: int
    name: str
    role: str
    position: list[float]
    velocity: list[float]
    size: list[float]
    yaw: float
    visible: float | None = None
    commanded_speed: float | None = None
    box_px: list[float] | None = None
    kind: Literal["robot", "person"] | None = None


class TruthPayload(msgspec.Struct, frozen=True, kw_only=True):
    """Ground truth at one frame.

    Attributes:
        camera_position, camera_orientation_wxyz: ``T_world_camera`` in the truth's own world.
    """

    frame: int
    time: float
    bodies: list[BodyPayload]
    camera_position: list[float] | None = None
    camera_orientation_wxyz: list[float] | None = None


class MatchedBody(msgspec.Struct, frozen=True, kw_only=True):
    """A true body in the observation's world, and the track matched to it."""

    id: int
    name: str
    role: str
    position: list[float]
    velocity: list[float]
    speed: float
    size: list[float]
    yaw: float
    visible: float | None = None
    commanded_speed: float | None = None
    track_id: int | None = None

    @staticmethod
    def of(entry: Mapping[str, Any]) -> MatchedBody:
        """Return the body of an entry of ``observer.truth.matching``."""
        return MatchedBody(**{name: entry[name] for name in MatchedBody.__struct_fields__})


class MatchedTruth(msgspec.Struct, frozen=True, kw_only=True):
    """True bodies at one observation.

    Attributes:
        sentence: why there are none, e.g. motion capture is not aligned yet.
    """

    frame: int
    time: float
    bodies: list[MatchedBody]
    sentence: str | None = None


class SamplePayload(msgspec.Struct, frozen=True, kw_only=True):
    """``BodySample``; ``rotation`` is ``R_room_body``, row by row."""

    name: str
    time: float
    received: float
    position: list[float] | None = None
    rotation: list[float] | None = None


class CapturePayload(msgspec.Struct, frozen=True):
    """Motion capture received since the last message."""

    samples: list[SamplePayload]


class RobotRow(msgspec.Struct, frozen=True, kw_only=True):
    """One robot at one instant.

    Attributes:
        role: ``observer`` or ``obstacle``. received: host's monotonic clock, seconds.
        time: the source's clock, where known.
        sent_speed, sent_turn_rate: as actually sent, m/s and rad/s.
        encoder_speed, encoder_turn_rate: as reported by the robot.
        x, y, yaw: wheel odometry, metres and radians.
        facts: everything else known of it.
    """

    role: str
    received: float
    time: float | None = None
    sent_speed: float | None = None
    sent_turn_rate: float | None = None
    encoder_speed: float | None = None
    encoder_turn_rate: float | None = None
    x: float | None = None
    y: float | None = None
    yaw: float | None = None
    facts: dict[str, Any] = {}


class LocalMapPayload(msgspec.Struct, frozen=True, kw_only=True):
    """Local map used to plan the path to a goal, recorded a few times a second.

    Attributes:
        frame, time: of the newest frame in it.
    """

    frame: int
    time: float
    map: OccupancyMap


class SkippedPayload(msgspec.Struct, frozen=True):
    """A frame that the source could not read, and why."""

    index: int
    reason: str


class Incident(msgspec.Struct, frozen=True, kw_only=True):
    """Event worth finding in a recording: a guard stop, lost frames, a gap.

    Attributes:
        kind: a word. sentence: what happened. received: host's monotonic clock, seconds.
        details: plain values by name.
    """

    kind: str
    sentence: str
    received: float
    details: dict[str, Any] = {}
