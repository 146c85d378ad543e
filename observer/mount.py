"""Mount of the camera on its robot, which gives a single camera its scale in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array, Pose

# From the robot's axes (x forward, y left, z up) to those of a level camera.
R_CAMERA_BASE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])

# A level camera at z = 0, in axes with x forward, y left, z up.
_T_LEVEL_CAMERA = Pose(R_CAMERA_BASE.T, np.zeros(3))


def R_base_camera(pan_rad: float, tilt_rad: float, roll_rad: float) -> Float64Array:
    """Return the rotation (3, 3) from a camera's axes to those it is mounted in (x forward, z up).

    Args:
        pan_rad, tilt_rad, roll_rad: as in ``CameraMount``.
    """
    pan = Pose.from_rotvec([0.0, 0.0, pan_rad], np.zeros(3)).rotation
    tilt = Pose.from_rotvec([0.0, tilt_rad, 0.0], np.zeros(3)).rotation
    roll = Pose.from_rotvec([roll_rad, 0.0, 0.0], np.zeros(3)).rotation
    return np.asarray(pan @ (tilt @ roll @ R_CAMERA_BASE.T), dtype=np.float64)


@dataclass(frozen=True)
class CameraMount:
    """The left camera on a robot that stands on flat ground.

    Starting level and looking ahead, the camera is turned about its own axes: by ``pan_rad`` to
    the left, by ``tilt_rad`` down, and last by ``roll_rad`` about its optical axis.

    Attributes:
        height_m: of the camera above the ground. tilt_rad: angle by which it looks down from the
            horizontal.
        forward_m, left_m: of the camera from the middle of the axle about which the robot turns;
            None where unknown.
        roll_rad: positive if its right side is lower than its left one: clockwise as seen from
            behind the camera. pan_rad: by which it looks to the left of the driving direction.
            Both are 0 if not measured: cameras are usually mounted straight.

    Raises:
        ValueError: the height is not positive or the camera does not look ahead.
    """

    height_m: float
    tilt_rad: float
    forward_m: float | None = None
    left_m: float | None = None
    roll_rad: float = 0.0
    pan_rad: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"the camera must be above the floor, not at {self.height_m} m")
        if not abs(self.tilt_rad) < math.pi / 2:
            raise ValueError("the camera must look ahead: its tilt must be within ±90 degrees")
        if not abs(self.roll_rad) < math.pi / 2:
            raise ValueError("the camera must be upright: its roll must be within ±90 degrees")
        if not abs(self.pan_rad) <= math.pi:
            raise ValueError("the camera's pan must be within ±180 degrees")

    @staticmethod
    def angles_of(down: Float64Array) -> tuple[float, float]:
        """Return tilt and roll, radians, of a camera with this direction of gravity.

        This is the inverse of the property ``down``.

        Args:
            down: (3,) unit vector in the camera's axes.
        """
        x, y, z = (float(value) for value in down)
        return math.atan2(z, math.hypot(x, y)), math.atan2(x, y)

    @property
    def down(self) -> Float64Array:
        """(3,) the direction of gravity in the camera's axes, unit length."""
        level, tilt, roll = math.cos(self.tilt_rad), self.tilt_rad, self.roll_rad
        return np.array([level * math.sin(roll), level * math.cos(roll), math.sin(tilt)])

    @property
    def T_base_camera(self) -> Pose:
        """The camera's pose on its robot; above the axle if its offset is unknown."""
        offset = np.array([self.forward_m or 0.0, self.left_m or 0.0, self.height_m])
        return Pose(self.R_base_camera, offset)

    @property
    def T_level_camera(self) -> Pose:
        """The camera's pose in level axes: z up from the ground below it, x where it looks, y left.

        It is ``T_base_camera`` without pan and offset, which levelling does not need. Applied to
        the world, which is a segment's first camera, it gives the display's frame.
        """
        level = R_base_camera(0.0, self.tilt_rad, self.roll_rad)
        return Pose(level, np.array([0.0, 0.0, self.height_m]))

    @property
    def lever_sigma_m(self) -> float:
        """Standard deviation of the offset from the axle, metres."""
        return 0.1 if self.forward_m is None or self.left_m is None else 0.01

    @property
    def R_base_camera(self) -> Float64Array:
        """(3, 3) from the camera's axes to the robot's (x forward, y left, z up)."""
        return R_base_camera(self.pan_rad, self.tilt_rad, self.roll_rad)


def level_pose(mount: CameraMount | None) -> Pose:
    """Return ``T_level_camera``: z up, x to where the camera looks, the ground at z = 0.

    Args:
        mount: None if unknown; the camera is then assumed to be level, at z = 0.
    """
    return _T_LEVEL_CAMERA if mount is None else mount.T_level_camera
