"""Oracle of ``observer.kernels.pose_fit``: the same formulas for all points at once, by numpy.

Coordinates are in rows (3, N), so that each operation runs over contiguous memory: with a few
hundred points the number of numpy calls dominates the cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, orthonormal, rotation_matrix
from observer.parameters import EgoMotionParameters

# px^2: variance of what was not seen, so that it does not count.
_UNKNOWN = 1e9
# Keeps the equations solvable where the points leave a direction open.
_DAMPING = 1e-9
_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
_REFINE_STEPS = 4
# Most points used to judge a sample; more would not make the choice more certain.
_JUDGES = 200
# If the expected pose explains this share of the image, a better one is near: then one step leads
# from it to that of a sample, and a few samples are enough.
_EXPECTED_SHARE = 0.6
_NEAR_BATCH, _NEAR_STEPS = 16, 1
# The refinement ends when a step changes the pose by less than this share of its uncertainty.
_CONVERGED = 0.02
_HUBER_SIGMAS = 2.0
# Residuals beyond this many standard deviations are outliers of the refinement.
_OUTLIER_SIGMAS = 3.5
# Rows and columns of the entries of a symmetric (3, 3) matrix that count.
_ROWS, _COLUMNS = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """N points: where they are in the world and where they are seen.

    Attributes:
        place: (3, N) metres, world. covariance: (9, N) m^2, of it.
        seen: (3, N) pixels: u, v and disparity; 0 where a disparity is unknown.
        known: (N,) whether the disparity is known.
        variance: (3, N) px^2, of what is seen.
    """

    place: Float64Array
    covariance: Float64Array
    seen: Float64Array
    known: NDArray[np.bool_]
    variance: Float64Array

    @staticmethod
    def of(
        position: Float64Array,
        covariance: Float64Array,
        px: Float64Array,
        disparity: Float64Array,
        sigma: Float64Array,
    ) -> SeenPoints:
        """Make them of (N, 3), (N, 3, 3), (N, 2), (N,) with NaN for unknown, and (N, 3)."""
        known = np.isfinite(disparity)
        seen = np.empty((3, len(px)))
        seen[0], seen[1], seen[2] = px[:, 0], px[:, 1], np.where(known, disparity, 0.0)
        return SeenPoints(
            place=np.ascontiguousarray(position.T),
            covariance=np.ascontiguousarray(covariance.reshape(-1, 9).T),
            seen=seen,
            known=known,
            variance=np.ascontiguousarray(sigma.T) ** 2,
        )

    def take(self, which: NDArray[np.intp]) -> SeenPoints:
        """Some of the points."""
        return SeenPoints(
            self.place.take(which, axis=1), self.covariance.take(which, axis=1),
            self.seen.take(which, axis=1), self.known[which], self.variance.take(which, axis=1),
        )  # fmt: skip

    def residuals(self, pose: Pose, camera: StereoCamera) -> Float64Array:
        """(3, N) pixels: seen minus predicted; 0 for unknown disparities, NaN behind the camera.

        Divides by zero or less silently only within ``numpy.errstate``.
        """
        p = pose.rotation @ self.place + pose.translation[:, None]
        return residuals(p, self.seen, self.known, camera)


@dataclass(frozen=True, eq=False)
class Linearised:
    """The residuals about a pose, scaled so that each point's have unit covariance.

    Attributes:
        sigma: (3, N) pixels, of u, v and disparity, of the sighting and of the place.
        factor: (6, N) the inverse of the Cholesky factor of the residuals' covariance.
        jacobian: (6, 3, N) derivative of the whitened residuals by a small rotation and
            translation; 0 for points that do not count.
        usable: (N,) which points count.
    """

    sigma: Float64Array
    factor: Float64Array
    jacobian: Float64Array
    usable: NDArray[np.bool_]

    def whitened(self, r: Float64Array) -> Float64Array:
        """Residuals (3, N) in standard deviations; 0 for points that do not count."""
        a, b, c, d, e, f = self.factor
        y = np.empty_like(r)
        y[0] = r[0] * a
        y[1] = r[0] * b + r[1] * c
        y[2] = r[0] * d + r[1] * e + r[2] * f
        y[:, ~self.usable] = 0.0
        return y


def residuals(
    p: Float64Array, seen: Float64Array, known: NDArray[np.bool_], camera: StereoCamera
) -> Float64Array:
    """(..., 3, N) pixels: seen (3, N) minus predicted of points (..., 3, N), camera frame."""
    z = p[..., 2, :]
    inverse = 1 / np.where(z > 0, z, np.nan)
    out = np.empty_like(p)
    out[..., 0, :] = seen[..., 0, :] - camera.cx - camera.fx * (p[..., 0, :] * inverse)
    out[..., 1, :] = seen[..., 1, :] - camera.cy - camera.fy * (p[..., 1, :] * inverse)
    out[..., 2, :] = (seen[..., 2, :] - camera.fx * camera.baseline * inverse) * known
    return out


def jacobian(p: Float64Array, camera: StereoCamera) -> Float64Array:
    """(6, 3, ...) derivative, by a small rotation and translation of points, of u, v, disparity.

    Args:
        p: (3, ...) metres, camera frame, in front of the camera.
    """
    w = 1 / p[2]
    a, b = p[0] * w, p[1] * w
    fu, fv = camera.fx * w, camera.fy * w
    g = fu * camera.baseline * w
    J = np.zeros((6, 3, *w.shape))
    ab = a * b
    J[0, 0], J[1, 0], J[2, 0] = -camera.fx * ab, camera.fx * (1 + a * a), -camera.fx * b
    J[0, 1], J[1, 1], J[2, 1] = -camera.fy * (1 + b * b), camera.fy * ab, camera.fy * a
    J[0, 2], J[1, 2] = -g * p[1], g * p[0]
    J[3, 0], J[4, 1] = fu, fv
    J[5, 0], J[5, 1], J[5, 2] = -fu * a, -fv * b, -g
    return J


def linearised(points: SeenPoints, pose: Pose, camera: StereoCamera) -> Linearised:
    """The scene about a pose. Use it within ``numpy.errstate`` for points behind the camera."""
    p = pose.rotation @ points.place + pose.translation[:, None]
    p[2][~(p[2] > 0)] = np.nan
    J = jacobian(p, camera)
    # R C R^T of all points as one product of matrices.
    turned = _twice(pose.rotation) @ points.covariance
    xx, xy, xz, yy, yz, zz = turned
    fu, fv, ga = J[3, 0], J[4, 1], J[5, 2]
    a, b = J[5, 0] / fu, J[5, 1] / fv
    variance = points.variance
    # Of u, v and disparity, each also by the place: the rows of J are (fu, 0, fu a) etc.
    xza, yzb = xz + a * zz, yz + b * zz
    s00 = variance[0] + fu * fu * (xx + a * (xz + xza))
    s11 = variance[1] + fv * fv * (yy + b * (yz + yzb))
    s22 = variance[2] + ga * ga * zz
    s01 = fu * fv * (xy + b * xz + a * yzb)
    s02 = fu * ga * xza
    s12 = fv * ga * yzb
    sigma = np.sqrt([s00, s11, s22])
    s22 = np.where(points.known, s22, s22 + _UNKNOWN)
    # Cholesky's factor and its inverse, written out.
    factor = np.empty((6, len(s00)))
    i0 = 1 / sigma[0]
    l10, l20 = s01 * i0, s02 * i0
    i1 = 1 / np.sqrt(s11 - l10 * l10)
    l21 = (s12 - l20 * l10) * i1
    i2 = 1 / np.sqrt(s22 - l20 * l20 - l21 * l21)
    factor[0], factor[2], factor[5] = i0, i1, i2
    factor[1] = -l10 * i0 * i1
    factor[3] = (l10 * i1 * l21 - l20) * i0 * i2
    factor[4] = -l21 * i1 * i2
    white = np.empty_like(J)
    white[:, 0] = J[:, 0] * i0
    white[:, 1] = J[:, 0] * factor[1] + J[:, 1] * i1
    white[:, 2] = J[:, 0] * factor[3] + J[:, 1] * factor[4] + J[:, 2] * i2
    usable = np.isfinite(factor).all(axis=0) & np.isfinite(p[0] + p[1])
    white[:, :, ~usable] = 0.0
    return Linearised(sigma, factor, white, usable)


def gauss_newton(
    linear: Linearised, white: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """The step (6,), rotation vector and translation, and the information (6, 6) of the pose.

    Args:
        white: (3, N) residuals as of ``Linearised.whitened``. weight: (N,) of each point.
    """
    J = linear.jacobian.reshape(6, -1)
    WJ = (linear.jacobian * weight).reshape(6, -1)
    A = WJ @ J.T
    step = np.linalg.solve(_damped(A), WJ @ white.ravel())
    return np.asarray(step, np.float64), A


def _damped(information: Float64Array) -> Float64Array:
    out = information.copy()
    out.flat[::7] += _DAMPING * (1 + np.diagonal(information))
    return out


def _twice(R: Float64Array) -> Float64Array:
    """(6, 9) matrix from the entries of C (3, 3) to the distinct ones of R C R^T."""
    return np.asarray((R[_ROWS, :, None] * R[_COLUMNS, None, :]).reshape(6, 9))


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of N points to a pose: whitened residuals (3, N), their lengths (N,), inliers (N,)."""

    white: Float64Array
    mahalanobis: Float64Array
    inliers: NDArray[np.bool_]


def fit_pose(
    points: SeenPoints,
    share: Float64Array,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, Fit, Float64Array]:
    """The pose, how the points fit it, and its information (6, 6)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _fitted(points, share, expected, camera, parameters, seed)


def _fitted(
    points: SeenPoints,
    share: Float64Array,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, Fit, Float64Array]:
    linear = linearised(points, expected, camera)
    pose = _ransac(points, share, linear, expected, camera, parameters, seed)
    if pose is not expected:
        linear = linearised(points, pose, camera)
    fit = _judged(points, pose, linear, camera, parameters, np.inf)
    information = np.zeros((6, 6))
    for step in range(_REFINE_STEPS):
        if np.count_nonzero(fit.inliers) < parameters.min_inliers:
            break
        # Huber's weights: points far off that are not outliers count only linearly.
        weight = np.minimum(1.0, _HUBER_SIGMAS / np.maximum(fit.mahalanobis, 1e-9)) * fit.inliers
        change, information = gauss_newton(linear, fit.white, weight)
        change = np.clip(change, -10.0, 10.0)
        pose = Pose.from_rotvec(change[:3], change[3:]) @ pose
        if step == 0:
            # From here on the pose changes too little to affect the derivatives.
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
) -> Fit:
    """Fit of the points: inliers within the threshold, allowing for each position's covariance."""
    r = points.residuals(pose, camera)
    white = linear.whitened(r)
    squared = (white * white).sum(axis=0)
    squared[~linear.usable] = np.inf
    scaled = r * (linear.sigma[0] / linear.sigma)
    mahalanobis = np.sqrt(squared)
    inliers = (scaled * scaled).sum(axis=0) <= parameters.ransac_threshold_px**2
    inliers &= mahalanobis <= most_sigmas
    return Fit(white, mahalanobis, inliers & linear.usable)


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
