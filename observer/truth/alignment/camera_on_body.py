"""Pose of a camera on a motion capture body, as six numbers that a person can measure."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields

import numpy as np

from observer.errors import TruthError
from observer.geometry import Pose
from observer.mount import R_base_camera

FARTHEST_M = 10.0
# Limits of the angles; at 90 degrees of tilt pan and roll cannot be distinguished.
LARGEST_DEG = {"pan_deg": 180.0, "tilt_deg": 90.0, "roll_deg": 180.0}


@dataclass(frozen=True)
class CameraOnBody:
    """The left camera in the axes of the body that carries it, as motion capture defines them.

    With all angles 0 it looks along the body's x, with the body's z up. The angles turn it as in
    ``observer.mount.CameraMount``.

    Attributes:
        x_m, y_m, z_m: from the body's origin to the camera, along the body's axes.
        pan_deg: about the body's z, from x towards y. tilt_deg: away from z, so down if z is up.
        roll_deg: about the viewing direction, clockwise as seen from behind the camera.

    Raises:
        TruthError: a number is not finite or out of range.
    """

    x_m: float
    y_m: float
    z_m: float
    pan_deg: float
    tilt_deg: float
    roll_deg: float

    def __post_init__(self) -> None:
        for each in fields(self):
            value, limit = getattr(self, each.name), LARGEST_DEG.get(each.name, FARTHEST_M)
            if not (math.isfinite(value) and abs(value) <= limit):
                raise TruthError(
                    f"{each.name} of the camera on its body must be between {-limit:g} and "
                    f"{limit:g}, not {value:g}"
                )

    @staticmethod
    def parse(text: str) -> CameraOnBody:
        """Parse ``X,Y,Z,PAN,TILT,ROLL``, as ``str`` writes it.

        Raises:
            TruthError: the text has another form.
        """
        try:
            x, y, z, pan, tilt, roll = (float(part) for part in text.split(","))
        except ValueError:
            raise TruthError(
                "give the camera on its body as X,Y,Z,PAN,TILT,ROLL in metres and degrees, for "
                f"example 0.12,0.06,0.25,0,10,0, not {text[:80]!r}"
            ) from None
        return CameraOnBody(x, y, z, pan, tilt, roll)

    def __str__(self) -> str:
        return ",".join(repr(float(value)) for value in astuple(self))

    @staticmethod
    def of_pose(T_body_camera: Pose) -> CameraOnBody:
        """Return the numbers that describe a pose; the inverse of ``T_body_camera``."""
        R = T_body_camera.rotation @ R_base_camera(0.0, 0.0, 0.0).T
        x, y, z = T_body_camera.translation.tolist()
        pan, tilt, roll = (
            math.degrees(angle)
            for angle in (
                math.atan2(R[1, 0], R[0, 0]),
                math.asin(min(1.0, max(-1.0, -R[2, 0]))),
                math.atan2(R[2, 1], R[2, 2]),
            )
        )
        return CameraOnBody(x, y, z, pan, tilt, roll)

    @property
    def T_body_camera(self) -> Pose:
        """Pose of the camera's axes (x right, y down, z forward) in the body's."""
        angles = (math.radians(angle) for angle in (self.pan_deg, self.tilt_deg, self.roll_deg))
        return Pose(R_base_camera(*angles), np.array([self.x_m, self.y_m, self.z_m]))
