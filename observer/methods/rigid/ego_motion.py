"""Step 4 with depth: the camera's own motion as a rigid motion with six degrees of freedom.

Static points keep their world positions; the pose is the one from which they project to where
they are seen now, in left pixel and disparity. RANSAC finds it; least squares on the inliers
refines it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.chi_square import quantile
from observer.geometry import Float64Array, Pose
from observer.kernels.pose_fit import fit_pose
from observer.methods.contract import WEAK_SHARE
from observer.parameters import EgoMotionParameters
from observer.robust import median
from observer.types import Status
from observer.vision.rigid_ego_motion import RigidEgoMotion

# Keeps the information invertible where the points do not constrain a direction.
_DAMPING = 1e-9
_MEDIAN_CHI2 = quantile(0.5, df=3)


@dataclass(frozen=True, eq=False)
class StaticScene:
    """N world points that are assumed static, and where they are seen now.

    Attributes:
        position: (N, 3) metres, world. covariance: (N, 3, 3) m^2.
        px: (N, 2) pixels now, left image. disparity: (N,) pixels now, NaN unknown.
        sigma: (N, 3) pixels, standard deviations of u, v and disparity.
        weight: (N,) share of the image a point stands for; where points are dense it is less, so
            that a well textured obstacle cannot outvote the background.
    """

    position: Float64Array
    covariance: Float64Array
    px: Float64Array
    disparity: Float64Array
    sigma: Float64Array
    weight: Float64Array

    def __len__(self) -> int:
        return len(self.position)


def estimate_rigid_motion(
    scene: StaticScene,
    T_previous_world: Pose,
    T_expected_world: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
    confirmed: Callable[[Pose], bool] = lambda _: False,
) -> RigidEgoMotion:
    """Find the camera's pose from static points by RANSAC, and refine it on the inliers.

    Args:
        T_previous_world: the pose at t. T_expected_world: the predicted pose now, where the search
            starts.
        seed: of the RANSAC samples; the frame number, so that equal input gives equal results.
        confirmed: whether something besides the images confirms ``T_current_previous``; called
            only where most points contradict it, e.g. when people fill the view.

    Returns:
        The motion; its status is ``lost``, with the reason, where the points do not allow a fit.
    """
    count = len(scene)
    if count < parameters.min_inliers:
        return _lost(
            camera,
            count,
            f"only {count} static points could be tracked, {parameters.min_inliers} are needed: "
            "too few features, or too large a motion",
        )
    pose, mahalanobis, inliers, information = _fitted(
        scene, T_expected_world, camera, parameters, seed
    )
    support = int(inliers.sum())
    if support < parameters.min_inliers:
        return _lost(
            camera,
            count,
            f"only {support} of {count} points agree on one motion, {parameters.min_inliers} are "
            "needed",
        )
    reasons = []
    if support < 2 * parameters.min_inliers:
        reasons.append(f"the ego-motion is supported by only {support} points")
    T_current_previous = pose @ T_previous_world.inverse()
    if support < WEAK_SHARE * count and not confirmed(T_current_previous):
        reasons.append(f"only {100 * support / count:.0f} % of the points agree on one motion")
    # Normalized residuals in three dimensions have a mean square of 3; more means more noise than
    # declared.
    rms = float(np.sqrt(np.mean(mahalanobis[inliers] ** 2)))
    excess = max(1.0, rms**2 / 3)
    # Correlated noise makes the pose less certain than independent noise would.
    shared = 1 + parameters.noise_correlation * support
    covariance = _inverse(information) * excess * shared
    return RigidEgoMotion(
        camera=camera,
        status=Status.DEGRADED if reasons else Status.OK,
        reasons=tuple(reasons),
        inliers=inliers,
        T_camera_world=pose,
        T_current_previous=T_current_previous,
        pose_covariance=covariance.astype(np.float64),
        noise_scale=float(np.sqrt(median(mahalanobis**2) / _MEDIAN_CHI2)),
    )


def _lost(camera: StereoCamera, count: int, reason: str) -> RigidEgoMotion:
    return RigidEgoMotion(camera, Status.LOST, (reason,), np.zeros(count, np.bool_))


def _fitted(
    scene: StaticScene,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, Float64Array, NDArray[np.bool_], Float64Array]:
    """Return the pose, Mahalanobis residuals (N,), inliers (N,), and information (6, 6)."""
    rotation, translation, mahalanobis, inliers, information = fit_pose(
        np.ascontiguousarray(scene.position, np.float64),
        np.ascontiguousarray(scene.covariance, np.float64),
        np.column_stack([scene.px, scene.disparity]).astype(np.float64, copy=False),
        np.square(scene.sigma),
        np.ascontiguousarray(scene.weight, np.float64),
        expected.rotation,
        expected.translation,
        camera.numbers,
        parameters.ransac_threshold_px,
        parameters.min_inliers,
        parameters.ransac_iterations,
        np.random.default_rng(seed).random((parameters.ransac_iterations, 3)),
    )
    return Pose(rotation, translation), mahalanobis, inliers, information


def _inverse(information: Float64Array) -> Float64Array:
    """Return a pose's covariance (6, 6); huge in directions that the points do not constrain."""
    damping = np.diag(_DAMPING * (1 + np.diagonal(information)))
    return np.asarray(np.linalg.inv(information + damping), np.float64)
