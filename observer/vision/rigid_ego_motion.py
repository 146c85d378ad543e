"""The camera's own motion as a rigid motion with six degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.types import Status


@dataclass(frozen=True, eq=False)
class RigidEgoMotion:
    """The camera's pose at t+dt, and its motion since t (see ``observer.types.EgoMotion``).

    Attributes:
        camera: the rectified pair, used by ``predict``.
        inliers: (N,) which points follow the motion: the static background.
        T_camera_world: pose at t+dt; None while lost.
        T_current_previous: the motion; None while lost.
        pose_covariance: (6, 6) of both, as rotation vector (rad) and translation (m) in the
            camera's axes; None while lost.
        noise_scale: ratio of the scatter of all points, not only the inliers, to their noise; by
            the median, so that obstacles do not count.
    """

    camera: StereoCamera
    status: Status
    reasons: tuple[str, ...]
    inliers: NDArray[np.bool_]
    T_camera_world: Pose | None = None
    T_current_previous: Pose | None = None
    pose_covariance: Float64Array | None = None
    noise_scale: float = 1.0

    @property
    def covariance(self) -> Float64Array | None:
        """(6, 6): the model's parameters are the motion itself."""
        return self.pose_covariance

    @property
    def homography(self) -> None:
        """None: no image is warped."""
        return None

    def refused(self, reason: str) -> RigidEgoMotion:
        """Return this motion as lost, for the given reason."""
        return RigidEgoMotion(self.camera, Status.LOST, (*self.reasons, reason), self.inliers)

    def predict(self, px: Float64Array, disparity: Float64Array | None) -> Float64Array:
        """Pixels (N, 2) at t+dt of static points at (N, 2) with disparity (N,) at t.

        NaN while lost and for points of unknown disparity.
        """
        px = np.asarray(px, dtype=np.float64).reshape(-1, 2)
        if self.T_current_previous is None or disparity is None:
            return np.full_like(px, np.nan)
        place = self.T_current_previous.apply(self.camera.triangulate(px, disparity))
        return self.camera.project(place)[0]
