"""The camera's motion over one frame, as the stages after the ego-motion need it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.vision.camera_rate import CameraRate
from observer.vision.rigid_ego_motion import RigidEgoMotion


@dataclass(frozen=True, eq=False)
class CameraStep:
    """Pose of the camera now, and its motion over the frame.

    Attributes:
        camera: the rectified pair.
        T_camera_world: the pose now.
        covariance: (6, 6) of the motion over the frame (rad, m), camera axes.
        rate: the motion per second.
        dt: seconds of the frame.
    """

    camera: StereoCamera
    T_camera_world: Pose
    covariance: Float64Array
    rate: CameraRate
    dt: float

    @staticmethod
    def of(camera: StereoCamera, ego: RigidEgoMotion, dt: float) -> CameraStep | None:
        """Return the step of an estimated motion over ``dt`` seconds; None while it is lost."""
        if ego.T_camera_world is None or ego.T_current_previous is None:
            return None
        assert ego.pose_covariance is not None
        rate = CameraRate.of(ego.T_current_previous, dt)
        return CameraStep(camera, ego.T_camera_world, ego.pose_covariance, rate, dt)

    @cached_property
    def T_world_camera(self) -> Pose:
        """The pose now, from the camera's frame to the world's."""
        return self.T_camera_world.inverse()

    @property
    def position(self) -> Float64Array:
        """(3,) metres, world: where the camera is."""
        return self.T_world_camera.translation

    def metres_of(self, radius_px: float, place: Float64Array) -> float:
        """Return the length in metres of a radius in pixels at a place (3,) m, world."""
        return radius_px / self.camera.fx * float(np.linalg.norm(place - self.position))
