"""The camera's pose from lines of sight alone: the one that explains where static points are seen.

Robust least squares whose kernel narrows from round to round (graduated non-convexity), combined
with priors: odometry or constant velocity, and the mount.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.inverse_depth import expected_sightings, inverse_2x2, sighting_noise
from observer.methods.monocular.rays import DEPTH_SHARED, RayPoints

# Standard deviations beyond which residuals get little weight, round by round.
_WIDTHS = (30.0, 15.0, 8.0, 5.0, 3.0, 3.0)
_OUTLIER_SIGMAS = 3.5
# Radians and metres, one standard deviation: how a robot's camera nods and bobs on flat ground.
_NOD_SIGMA, _BOB_SIGMA_M = 0.004, 0.005


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Estimated pose of the camera.

    Attributes:
        T_camera_world: the pose. covariance: (6, 6) as a rotation vector (rad) and a translation
            (m) in the camera's axes.
        inliers: (N,) which of all points agree with it. noise_scale: median ratio of the points'
            scatter to their noise.
    """

    T_camera_world: Pose
    covariance: Float64Array
    inliers: NDArray[np.bool_]
    noise_scale: float


def estimate_pose(
    points: RayPoints,
    use: NDArray[np.bool_],
    weight: Float64Array,
    T_expected: Pose,
    prior: Float64Array,
    ground: GroundPlane | None,
    noise_correlation: float,
    camera: StereoCamera,
) -> PoseEstimate:
    """Estimate the pose from the points in use.

    Args:
        use: (N,) points assumed static. weight: (N,) share of the image each represents.
        T_expected: the predicted pose. prior: (6, 6) its information.
        ground: above which the camera keeps its height and tilt; None where unknown.
        noise_correlation: share of the noise that points have in common.
    """
    chosen = points.take(use)
    share = weight[use]
    noise = sighting_noise(chosen)
    # All depths come from the same poses, so their errors are correlated.
    doubt = DEPTH_SHARED * chosen.variance
    pose, information, length = T_expected, prior, np.zeros(len(chosen))
    for width in _WIDTHS:
        seen = expected_sightings(chosen, pose, camera)
        r = chosen.px - seen.px
        H = seen.by_inverse
        S = noise[:, None, None] * np.eye(2) + doubt[:, None, None] * (
            H[:, :, None] * H[:, None, :]
        )
        good = np.asarray(np.isfinite(r).all(axis=1))
        W = inverse_2x2(np.where(good[:, None, None], S, np.eye(2)))
        r, J = np.where(good[:, None], r, 0.0), np.where(good[:, None, None], seen.by_pose, 0.0)
        squared = np.einsum("ni,nij,nj->n", r, W, r)
        length = np.where(good, np.sqrt(np.maximum(squared, 0.0)), np.inf)
        trust = share * (width**2 / (width**2 + length**2)) ** 2
        WJ = W @ J * trust[:, None, None]
        A = np.einsum("nai,naj->ij", J, WJ)
        b = np.einsum("nai,na->i", WJ, r)
        gap = difference(T_expected, pose)
        A, b = A + prior, b + prior @ gap
        if ground is not None:
            extra, pull = held_above_ground(pose, ground)
            A, b = A + extra, b + pull
        information = A
        step = np.linalg.lstsq(A, b, rcond=1e-12)[0]
        pose = moved_by(pose, step)
    inliers = np.zeros(len(points), np.bool_)
    inliers[np.flatnonzero(use)] = length <= _OUTLIER_SIGMAS
    known = chosen.known & np.isfinite(length)
    # The median of a chi distribution with two degrees of freedom is 1.177.
    scale = float(np.median(length[known])) / 1.177 if known.sum() >= 8 else 1.0
    excess = max(1.0, scale) ** 2 * (1 + noise_correlation * int(inliers.sum()))
    covariance = np.asarray(np.linalg.pinv(information) * excess, np.float64)
    return PoseEstimate(pose, covariance, inliers, scale)


def difference(T_expected: Pose, pose: Pose) -> Float64Array:
    """(6,) the small motion, camera axes, from a pose to the expected one."""
    step = T_expected @ pose.inverse()
    return np.concatenate([step.rotvec, step.translation])


def moved_by(pose: Pose, step: Float64Array) -> Pose:
    turn = Rotation.from_rotvec(np.clip(step[:3], -0.5, 0.5)).as_matrix()
    return Pose(turn, np.clip(step[3:], -5.0, 5.0)) @ pose


def held_above_ground(pose: Pose, ground: GroundPlane) -> tuple[Float64Array, Float64Array]:
    """Return the information (6, 6) and vector (6,) that hold the first frame's height and tilt."""
    A, b = np.zeros((6, 6)), np.zeros(6)
    down = pose.rotate(ground.down)
    J = -cross_matrix(down)
    A[:3, :3] = J.T @ J / _NOD_SIGMA**2
    b[:3] = J.T @ (ground.down - down) / _NOD_SIGMA**2
    height = float(ground.height_of(pose.inverse().translation))
    A[3:, 3:] = np.outer(down, down) / _BOB_SIGMA_M**2
    b[3:] = down * (ground.depth - height) / _BOB_SIGMA_M**2
    return A, b
