"""Oracle of ``observer.kernels.pose_ransac``: the samples of a batch all at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, orthonormal, rotation_matrix
from observer.parameters import EgoMotionParameters

from .pose_residuals import Linearised, SeenPoints, jacobian, residuals

# Keeps the equations solvable where the points leave a direction open.
_DAMPING = 1e-9
_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
# Most points used to judge a sample; more would not make the choice more certain.
_JUDGES = 200
# If the expected pose explains this share of the image, a better one is near: then one step leads
# from it to that of a sample, and a few samples are enough.
_EXPECTED_SHARE = 0.6
_NEAR_BATCH, _NEAR_STEPS = 16, 1
# A judge's cost is that of an inlier of the refinement at most.
_OUTLIER_SIGMAS = 3.5


def ransac(
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
    # Drawn by weight, so that many points on one obstacle do not dominate the samples.
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
    """Number of samples needed to draw one without outliers almost surely.

    Args:
        explained: (K,) which of the judging points the best pose so far explains. weight: (K,).
    """
    share = float(explained @ weight / max(float(weight.sum()), 1e-9))
    miss = np.log1p(-min(share**_SAMPLE, 1 - 1e-9)) if share > 0 else -1e-9
    return float(np.log(1 - _CONFIDENCE) / miss)


def _cost(squared: Float64Array, cap: Float64Array, weight: Float64Array) -> Float64Array:
    """(S,) cost of S poses: an outlier costs as the worst inlier (MSAC; Torr, Zisserman 2000).

    Args:
        squared: (S, K) residuals. cap: (K,) of the worst inlier; not finite: does not count.
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
        # Three nearly collinear points give arbitrary rotations; they lose, and must not overflow.
        step = np.clip(step, -1e3, 1e3)
        turn = rotation_matrix(step[:, :3])
        R, t = turn @ R, (turn @ t[..., None])[..., 0] + step[:, 3:]
    return R, t
