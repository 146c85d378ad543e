"""Step 4 with depth: the camera's own motion as a rigid one, with six degrees of freedom.

The points that do not move are where they were in the world; the pose is the one from which they
look as they do now, in the left image and in their disparity. RANSAC finds it, least squares on
its inliers refine it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, orthonormal, rotation_matrix
from observer.parameters import EgoMotionParameters
from observer.robust import median
from observer.types import Status
from observer.vision.chi_square import quantile
from observer.vision.pose_fit import (
    Linearised,
    SeenPoints,
    gauss_newton,
    inverse_information,
    jacobian,
    linearised,
    residuals,
)
from observer.vision.rigid_ego_motion import RigidEgoMotion

_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
_REFINE_STEPS = 4
# Most points used to judge a sample; more do not make the better one better known.
_JUDGES = 200
# A pose that explains less than this share of the points may follow an obstacle instead.
_WEAK_SHARE = 0.4
# If the expected pose explains this share of the image, a better one is near: then one step leads
# from it to that of a sample, and a few samples are enough.
_EXPECTED_SHARE = 0.6
_NEAR_BATCH, _NEAR_STEPS = 16, 1
# The refinement ends when a step changes the pose by less than this share of its uncertainty.
_CONVERGED = 0.02
_HUBER_SIGMAS = 2.0
# Residuals beyond this many standard deviations are outliers of the refinement.
_OUTLIER_SIGMAS = 3.5
_DAMPING = 1e-9
_MEDIAN_CHI2 = quantile(0.5, df=3)


@dataclass(frozen=True, eq=False)
class StaticScene:
    """N points of the world that are taken for static, and where they are seen now.

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
        T_previous_world: the pose at t. T_expected_world: about where the camera should be now;
            where the search begins.
        seed: decides the samples; the frame's number, so that equal input gives equal results.
        confirmed: whether something besides the images tells a motion ``T_current_previous``; asked
            only where most points contradict it, as where people fill the view.

    Returns:
        A motion whose status is ``lost``, with the reason, where the points do not allow one.
    """
    count = len(scene)
    if count < parameters.min_inliers:
        return _lost(
            camera,
            count,
            f"only {count} static points could be tracked, {parameters.min_inliers} are needed: "
            "too few features, or too large a motion",
        )
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pose, fit, information = _fitted(scene, T_expected_world, camera, parameters, seed)
    inliers, mahalanobis = fit.inliers, fit.mahalanobis
    rms = float(np.sqrt(np.mean(mahalanobis[inliers] ** 2))) if inliers.any() else float("nan")
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
    if support < _WEAK_SHARE * count and not confirmed(T_current_previous):
        reasons.append(f"only {100 * support / count:.0f} % of the points agree on one motion")
    # Residuals of three dimensions have a mean square of 3; more means more noise than declared.
    excess = max(1.0, rms**2 / 3)
    # Correlated noise makes the result worse than independent noise would.
    shared = 1 + parameters.noise_correlation * support
    covariance = inverse_information(information) * excess * shared
    return RigidEgoMotion(
        camera=camera,
        status=Status.DEGRADED if reasons else Status.OK,
        reasons=tuple(reasons),
        inliers=inliers,
        T_camera_world=pose,
        T_current_previous=T_current_previous,
        pose_covariance=covariance.astype(np.float64),
        residual_rms=rms,
        noise_scale=float(np.sqrt(median(mahalanobis**2) / _MEDIAN_CHI2)),
    )


def _lost(camera: StereoCamera, count: int, reason: str) -> RigidEgoMotion:
    return RigidEgoMotion(camera, Status.LOST, (reason,), np.zeros(count, np.bool_))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Fit of N points to a pose: whitened residuals (3, N), their lengths (N,), inliers (N,)."""

    white: Float64Array
    mahalanobis: Float64Array
    inliers: NDArray[np.bool_]


def _fitted(
    scene: StaticScene,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, _Fit, Float64Array]:
    """The pose, how the points fit it, and its information (6, 6)."""
    points = SeenPoints.of(scene.position, scene.covariance, scene.px, scene.disparity, scene.sigma)
    linear = linearised(points, expected, camera)
    pose = _ransac(points, scene.weight, linear, expected, camera, parameters, seed)
    if pose is not expected:
        linear = linearised(points, pose, camera)
    fit = _judged(points, pose, linear, camera, parameters, np.inf)
    information = np.zeros((6, 6))
    for step in range(_REFINE_STEPS):
        if np.count_nonzero(fit.inliers) < parameters.min_inliers:
            break
        # Huber's weights: what is far off, yet no outlier, counts by its distance only.
        weight = np.minimum(1.0, _HUBER_SIGMAS / np.maximum(fit.mahalanobis, 1e-9)) * fit.inliers
        change, information = gauss_newton(linear, fit.white, weight)
        change = np.clip(change, -10.0, 10.0)
        pose = Pose.from_rotvec(change[:3], change[3:]) @ pose
        if step == 0:
            # From here on the pose changes too little to matter for the derivatives.
            linear = linearised(points, pose, camera)
        fit = _judged(points, pose, linear, camera, parameters, _OUTLIER_SIGMAS)
        if step and change @ information @ change < _CONVERGED**2:
            break
    return pose, fit, information


def _judged(
    points: SeenPoints,
    pose: Pose,
    linear: Linearised,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    most_sigmas: float,
) -> _Fit:
    """Fit of the points: inliers within the threshold, allowing for each position's covariance."""
    r = points.residuals(pose, camera)
    white = linear.whitened(r)
    squared = (white * white).sum(axis=0)
    squared[~linear.usable] = np.inf
    scaled = r * (linear.sigma[0] / linear.sigma)
    mahalanobis = np.sqrt(squared)
    inliers = (scaled * scaled).sum(axis=0) <= parameters.ransac_threshold_px**2
    inliers &= mahalanobis <= most_sigmas
    return _Fit(white, mahalanobis, inliers & linear.usable)


def _ransac(
    points: SeenPoints,
    share: Float64Array,
    linear: Linearised,
    start: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> Pose:
    """The best of many poses, each the least-squares fit of three points, all tried at once.

    As in libviso2 (Geiger et al., StereoScan, 2011); a sample of three points with disparity is
    solved by a few Gauss-Newton steps from the expected pose, which is a candidate itself.
    """
    deep = np.flatnonzero(points.known)
    if len(deep) < _SAMPLE:
        return start
    count = len(points.known)
    judges = np.linspace(0, count - 1, min(_JUDGES, count)).astype(np.intp)
    judging = points.take(judges)
    sigma = linear.sigma.take(judges, axis=1)
    limit = np.minimum(parameters.ransac_threshold_px, _OUTLIER_SIGMAS * sigma[0])
    cap = (limit / sigma[0]) ** 2
    weight = share[judges]
    squared = _squared(judging, sigma, start.rotation[None], start.translation[None], camera)
    near = (squared[0] <= cap) @ weight >= _EXPECTED_SHARE * weight.sum()
    batch, steps = (_NEAR_BATCH, _NEAR_STEPS) if near else (_BATCH, _SAMPLE_STEPS)
    rng = np.random.default_rng(seed)
    best, best_cost = start, float(_cost(squared, cap, weight)[0])
    tried = 0
    wanted = min(float(parameters.ransac_iterations), _samples(squared[0] <= cap, weight))
    # Drawn by weight, so that a crowd of points on an obstacle is not drawn again and again.
    drawn = np.cumsum(share[deep])
    while tried < wanted:
        chance = rng.random((batch, _SAMPLE)) * drawn[-1]
        sample = deep[np.minimum(np.searchsorted(drawn, chance), len(deep) - 1)]
        R, t = _sampled(points, sample, start, camera, steps)
        squared = _squared(judging, sigma, R, t, camera)
        cost = _cost(squared, cap, weight)
        number = int(np.argmin(cost))
        if cost[number] < best_cost:
            best_cost = float(cost[number])
            best = Pose(orthonormal(R[number]), t[number])
            wanted = min(wanted, _samples(squared[number] <= cap, weight))
        tried += batch
    return best


def _samples(explained: NDArray[np.bool_], weight: Float64Array) -> float:
    """Number of samples needed to draw one without outliers, almost surely.

    Args:
        explained: (K,) which judges the best pose so far explains. weight: (K,) of each.
    """
    share = float(explained @ weight / max(float(weight.sum()), 1e-9))
    miss = np.log1p(-min(share**_SAMPLE, 1 - 1e-9)) if share > 0 else -1e-9
    return float(np.log(1 - _CONFIDENCE) / miss)


def _cost(squared: Float64Array, cap: Float64Array, weight: Float64Array) -> Float64Array:
    """(S,) of S poses: an outlier costs what the worst inlier costs (MSAC; Torr, Zisserman 2000).

    Args:
        squared: (S, K) residuals. cap: (K,) of the worst inlier; what has none does not count.
    """
    known = np.isfinite(cap)
    return np.asarray(np.minimum(squared, np.where(known, cap, 0.0)) @ (weight * known))


def _squared(
    points: SeenPoints, sigma: Float64Array, R: Float64Array, t: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(S, K) squared residuals of K points at S poses, in standard deviations (3, K)."""
    p = R @ points.place + t[:, :, None]
    r = residuals(p, points.seen, points.known, camera) / sigma
    squared = (r * r).sum(axis=1)
    return np.where(np.isfinite(squared), squared, np.inf)


def _sampled(
    points: SeenPoints, sample: NDArray[np.intp], start: Pose, camera: StereoCamera, steps: int
) -> tuple[Float64Array, Float64Array]:
    """Poses (S, 3, 3) and (S, 3) by which S samples of K points each are seen where they are."""
    count = len(sample)
    R = np.broadcast_to(start.rotation, (count, 3, 3))
    t = np.broadcast_to(start.translation, (count, 3))
    place, seen, variance = (
        values.take(sample, axis=1).swapaxes(0, 1)
        for values in (points.place, points.seen, points.variance)
    )
    known, sigma = points.known[sample], np.sqrt(variance)
    for _ in range(steps):
        p = R @ place + t[:, :, None]
        r = (residuals(p, seen, known, camera) / sigma).reshape(count, -1)
        J = jacobian(p.swapaxes(0, 1), camera) / sigma.swapaxes(0, 1)
        J = J.transpose(2, 1, 3, 0).reshape(count, -1, 6)
        bad = ~(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(r).all(axis=1))
        J[bad], r[bad] = 0.0, 0.0
        A = np.swapaxes(J, 1, 2) @ J
        A[:, range(6), range(6)] += _DAMPING + 1e-6 * A[:, range(6), range(6)]
        step = np.linalg.solve(A, np.einsum("sai,sa->si", J, r)[..., None])[..., 0]
        # Three points nearly in a line turn anyhow; such samples lose, and must not overflow.
        step = np.clip(step, -1e3, 1e3)
        turn = rotation_matrix(step[:, :3])
        R, t = turn @ R, (turn @ t[..., None])[..., 0] + step[:, 3:]
    return R, t
