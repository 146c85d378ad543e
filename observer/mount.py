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

    Raises:
        ValueError: the height is not positive or the camera does not look ahead.
    """

    height_m: float
    tilt_rad: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height_m) and self.height_m > 0):
            raise ValueError(f"a camera stands above the floor, not at {self.height_m} m")
        if not abs(self.tilt_rad) < math.pi / 2:
            raise ValueError("a camera looks ahead: its tilt must lie within 90 degrees")

    @staticmethod
    def of(height_m: float | None, tilt_rad: float | None) -> CameraMount | None:
        """The mount where both are known, else None."""
        if height_m is None or tilt_rad is None:
            return None
        return CameraMount(height_m, tilt_rad)

    @property
    def down(self) -> Float64Array:
        """(3,) the direction of gravity in the camera's axes, unit length."""
        return np.array([0.0, math.cos(self.tilt_rad), math.sin(self.tilt_rad)])

    @property
    def R_base_camera(self) -> Float64Array:
        """(3, 3) from the camera's axes to the robot's (x forward, y left, z up)."""
        turn = Pose.from_rotvec([0.0, self.tilt_rad, 0.0], np.zeros(3)).rotation
        return np.asarray(turn @ _R_CAMERA_BASE.T, dtype=np.float64)
