"""The flat ground on which the robot and all obstacles stand, in the world of one segment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The plane ``down . X = depth``; its own axes are ``right`` and ``ahead``.

    Attributes:
        down: (3,) unit vector, world. depth: metres of the ground below the world's origin.
    """

    down: Float64Array
    depth: float

    @staticmethod
    def below(mount: CameraMount) -> GroundPlane:
        """Return the ground below the camera of a segment's first frame."""
        return GroundPlane(mount.down, mount.height_m)

    @property
    def axes(self) -> Float64Array:
        """(3, 2) right and ahead on the ground, world."""
        right = np.array([1.0, 0.0, 0.0]) - self.down[0] * self.down
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, self.down)], axis=1)

    def height_of(self, place: Float64Array) -> Float64Array:
        """(...) metres above the ground of places (..., 3), world."""
        return np.asarray(self.depth - place @ self.down)

    def inverse_distance(self, centre: Float64Array, ray: Float64Array) -> Float64Array:
        """(N,) 1/m along unit rays (N, 3) from (3,) or (N, 3); negative above the horizon."""
        return np.asarray((ray @ self.down) / self.height_of(centre))


@dataclass(frozen=True, eq=False)
class GroundView:
    """The ground as the left camera sees it from one pose."""

    ground: GroundPlane
    T_world_camera: Pose
    camera: StereoCamera

    @property
    def here(self) -> Float64Array:
        """(2,) metres, ground axes: below the camera."""
        return self.ground.axes.T @ self.T_world_camera.translation

    def contact(self, px: Float64Array) -> Float64Array | None:
        """(3,) metres, world: where a pixel (2,) sees the ground; None above the horizon."""
        c = self.camera
        ray = self.T_world_camera.rotate([(px[0] - c.cx) / c.fx, (px[1] - c.cy) / c.fy, 1.0])
        slope = float(ray @ self.ground.down)
        if slope <= 1e-6:
            return None
        centre = self.T_world_camera.translation
        reach = float(self.ground.height_of(centre)) / slope
        return np.asarray(centre + reach * ray)

    def seen(self, place: Float64Array) -> Float64Array:
        """(3,) metres, camera frame: a place (2,) on the ground."""
        ground = self.ground
        return self.T_world_camera.inverse().apply(ground.axes @ place + ground.depth * ground.down)
