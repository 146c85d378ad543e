"""How the camera is mounted on the robot: what one camera needs to know depth in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array, Pose

# From the robot's axes (x forward, y left, z up) to those of a level camera.
_R_CAMERA_BASE = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class CameraMount:
    """The left camera on a robot that stands on a flat floor.

    Attributes:
        height_m: of the camera above the floor. tilt_rad: angle by which it looks down from the
            horizontal.
        forward_m, left_m: of the camera from the middle of the axle about which the robot turns;
            None where unknown.

    Raises:
        ValueError: the height is not positive or the camera does not look ahead.
    """

    height_m: float
    tilt_rad: float
    forward_m: float | None = None
    left_m: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"a camera stands above the floor, not at {self.height_m} m")
        if not abs(self.tilt_rad) < math.pi / 2:
            raise ValueError("a camera looks ahead: its tilt must lie within 90 degrees")

    @property
    def down(self) -> Float64Array:
        """(3,) the direction of gravity in the camera's axes, unit length."""
        return np.array([0.0, math.cos(self.tilt_rad), math.sin(self.tilt_rad)])

    @property
    def T_base_camera(self) -> Pose:
        """The camera on its robot; as if above the axle where its offset is unknown."""
        offset = np.array([self.forward_m or 0.0, self.left_m or 0.0, self.height_m])
        return Pose(self.R_base_camera, offset)

    @property
    def lever_sigma_m(self) -> float:
        """How well the offset from the axle is known, one standard deviation, metres."""
        return 0.1 if self.forward_m is None or self.left_m is None else 0.01

    @property
    def R_base_camera(self) -> Float64Array:
        """(3, 3) from the camera's axes to the robot's (x forward, y left, z up)."""
        turn = Pose.from_rotvec([0.0, self.tilt_rad, 0.0], np.zeros(3)).rotation
        return np.asarray(turn @ _R_CAMERA_BASE.T, dtype=np.float64)
