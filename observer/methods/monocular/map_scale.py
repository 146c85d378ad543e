"""Correction of the scale of one camera's map, so that it does not drift."""

from __future__ import annotations

import numpy as np

from observer.geometry import Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.ground_odometry import GroundOdometer
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.scale import (
    correction,
    ground_scale,
    odometry_scale,
    sigma_after_distance,
)
from observer.parameters import MonocularParameters
from observer.types import Image, Odometry
from observer.vision.wheel_odometry import driven_distance


class MapScale:
    """The scale of one segment, corrected by the ground and by odometry where available.

    Attributes:
        odometry: wheel odometry at the place from which distances are compared; None unknown.
    """

    def __init__(
        self,
        sigma: float,
        ground: GroundPlane | None,
        T_camera_world: Pose,
        odometry: Odometry | None,
    ) -> None:
        self._sigma = sigma
        self._ground = ground
        self._T_mark = T_camera_world
        self.odometry = odometry

    def sigma(self, p: MonocularParameters) -> float:
        """Return one sigma of all lengths, as a share, including errors of height and odometry."""
        reference = p.height_sigma if self._ground is not None else np.inf
        if self.odometry is not None:
            reference = min(reference, p.odometry_sigma)
        return float(np.hypot(self._sigma, reference if np.isfinite(reference) else 0.0))

    def corrected(
        self,
        points: RayPoints,
        T_camera_world: Pose,
        T_before_world: Pose,
        odometry: Odometry | None,
        ground_odometer: GroundOdometer | None,
        image: Image,
        p: MonocularParameters,
    ) -> RayPoints:
        """Return the map after one more frame, rescaled about the camera.

        Args:
            T_camera_world, T_before_world: the camera's pose now and in the frame before.
            ground_odometer: measures motion from the ground; None where wheel odometry is used.
            image: (H, W) grey, of this frame.
        """
        moved = T_camera_world @ T_before_world.inverse()
        self._sigma = sigma_after_distance(self._sigma, float(np.linalg.norm(moved.translation)))
        here = T_camera_world.inverse()
        factor = self._by_odometry(T_camera_world, odometry, p)
        # If the ground is bare, points that seem to lie on it belong to objects in front of it.
        if ground_odometer is None or not ground_odometer.sees:
            factor *= self._by_ground(points, here)
        if ground_odometer is not None:
            factor *= self._taken(ground_odometer.compared(image, T_camera_world))
        if factor == 1.0:
            return points
        return points.but(
            centre=here.translation + factor * (points.centre - here.translation),
            inverse=points.inverse / factor,
            variance=points.variance / factor**2,
        )

    def _by_ground(self, points: RayPoints, T_world_camera: Pose) -> float:
        if self._ground is None:
            return 1.0
        return self._taken(ground_scale(points, T_world_camera, self._ground, self._sigma))

    def _by_odometry(
        self, T_camera_world: Pose, odometry: Odometry | None, p: MonocularParameters
    ) -> float:
        driven = driven_distance(self.odometry, odometry)
        if driven is None or self.odometry is None or odometry is None:
            return 1.0
        mapped_m = float(np.linalg.norm((T_camera_world @ self._T_mark.inverse()).translation))
        measured = odometry_scale(
            mapped_m, driven, odometry.yaw - self.odometry.yaw, p.odometry_sigma
        )
        if measured is not None:
            self._T_mark, self.odometry = T_camera_world, odometry
        return self._taken(measured)

    def _taken(self, measured: tuple[float, float] | None) -> float:
        if measured is None:
            return 1.0
        factor, self._sigma = correction(self._sigma, *measured)
        return factor
