"""Contract of a source of ground truth (motion capture, simulator, file); never an input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

from observer.geometry import Float64Array, Pose
from observer.types import BoxPx

Kind = Literal["robot", "person"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, eq=False)
class TrueBody:
    """True state of a body at one instant, in the observer's world frame.

    The world frame is the camera frame (x right, y down, z forward) at the source's first frame.

    Attributes:
        id: the body's number. name: its name, for people. role: ``observer`` or ``obstacle``.
        position: (3,) metres, the body's centre. velocity: (3,) m/s.
        size: (3,) metres, length (along its heading), width, height.
        yaw: heading in the world's x-z plane, radians: the body drives towards
            (sin yaw, 0, cos yaw), so 0 is straight ahead and positive is to the right.
        visible: share of the body that the left camera sees, 0 to 1; None where unknown.
        commanded_speed: m/s as commanded to the robot, None where unknown.
        box_px: around what the left camera sees of it; None where it sees nothing of it, or
            where that is unknown.
        kind: None where unknown.
    """

    id: int
    name: str
    role: str
    position: Float64Array
    velocity: Float64Array
    size: Float64Array
    yaw: float
    visible: float | None
    commanded_speed: float | None
    box_px: BoxPx | None = None
    kind: Kind | None = None

    @property
    def speed(self) -> float:
        """Length of the velocity, m/s."""
        return float((self.velocity @ self.velocity) ** 0.5)


class Truth(Protocol):
    """True states over time, on the source's clock."""

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        """Return every body known at ``time``; bodies in a gap are left out."""
        ...

    def camera_pose(self, time: float) -> Pose | None:
        """Return ``T_world_camera``, or None where unknown."""
        ...
