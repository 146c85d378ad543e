"""A camera's pose from points of known places: RANSAC, and least squares on its inliers."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    CAMERA,
    REAL,
    REALS1,
    REALS2,
    REALS3,
    WHOLE,
    Camera,
    Flags,
    Indices,
    Reals,
    kernel,
    part,
)
from observer.kernels.small import clear, copy_pose, solved, turned

# Variance, px^2, given to an unknown disparity, so that it does not count.
_UNKNOWN = 1e9
# Keeps the equations solvable where the points do not constrain a direction.
_DAMPING = 1e-9
_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
_REFINE_STEPS = 4
# Most points used to score a sample; more do not make the ranking more reliable.
_JUDGES = 200
# If the expected pose explains this share of the image, the best pose is near: then a few samples
# with one Gauss-Newton step each are enough.
_EXPECTED_SHARE = 0.6
_NEAR_BATCH, _NEAR_STEPS = 16, 1
# The refinement ends when a step changes the pose by less than this share of its uncertainty.
_CONVERGED = 0.02
_HUBER_SIGMAS = 2.0
# Residuals beyond this many standard deviations are outliers of the refinement.
_OUTLIER_SIGMAS = 3.5
# Limits of a step: three nearly collinear points leave a rotation undetermined; such samples lose,
# but must not overflow.
_LARGEST_SAMPLE_STEP, _LARGEST_STEP = 1e3, 10.0


@part
def _residual(
    place: Reals, seen: Reals, R: Reals, t: Reals, camera: Camera, i: int, r: Reals
) -> tuple[float, float, float]:
    """Write u, v and disparity of point i, seen minus predicted, to r (3,); return x, y, z.

    These are in the camera frame; z is NaN if the point is not in front of the camera.
    """
    fx, fy, cx, cy, baseline = camera
    x = R[0, 0] * place[i, 0] + R[0, 1] * place[i, 1] + R[0, 2] * place[i, 2] + t[0]
    y = R[1, 0] * place[i, 0] + R[1, 1] * place[i, 1] + R[1, 2] * place[i, 2] + t[1]
    z = R[2, 0] * place[i, 0] + R[2, 1] * place[i, 1] + R[2, 2] * place[i, 2] + t[2]
    if not z > 0.0:
        return x, y, np.nan
    r[0] = seen[i, 0] - cx - fx * (x / z)
    r[1] = seen[i, 1] - cy - fy * (y / z)
    # NaN is an unknown disparity.
    r[2] = seen[i, 2] - fx * baseline / z if seen[i, 2] == seen[i, 2] else 0.0
    return x, y, z


@part
def _jacobian(x: float, y: float, z: float, camera: Camera, J: Reals) -> None:
    """Write the derivative of u, v, disparity by a small rotation and translation to J (3, 6)."""
    fx, fy, _, _, baseline = camera
    w = 1.0 / z
    a, b = x * w, y * w
    fu, fv = fx * w, fy * w
    g = fu * baseline * w
    J[0, 0], J[0, 1], J[0, 2] = -fx * a * b, fx * (1.0 + a * a), -fx * b
    J[1, 0], J[1, 1], J[1, 2] = -fy * (1.0 + b * b), fy * a * b, fy * a
    J[2, 0], J[2, 1], J[2, 2] = -g * y, g * x, 0.0
    J[0, 3], J[0, 4], J[0, 5] = fu, 0.0, -fu * a
    J[1, 3], J[1, 4], J[1, 5] = 0.0, fv, -fv * b
    J[2, 3], J[2, 4], J[2, 5] = 0.0, 0.0, -g


@part
def _linearise(
    place: Reals,
    covariance: Reals,
    seen: Reals,
    variance: Reals,
    R: Reals,
    t: Reals,
    camera: Camera,
    sigma: Reals,
    factor: Reals,
    jacobian: Reals,
    usable: Flags,
) -> None:
    """Linearise the scene about a pose, whitened to unit covariance of each point's residuals.

    Writes sigma (N, 3) of u, v and disparity, from sighting and place together; factor (N, 6), the
    inverse of the Cholesky factor of their covariance; jacobian (N, 3, 6) whitened; usable (N,).
    """
    J, r = np.empty((3, 6)), np.empty(3)
    M, C = np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(place)):
        x, y, z = _residual(place, seen, R, t, camera, i, r)
        usable[i] = z > 0.0 and math.isfinite(x + y)
        if not usable[i]:
            sigma[i, 0] = sigma[i, 1] = sigma[i, 2] = np.nan
            continue
        _jacobian(x, y, z, camera, J)
        # The place's covariance rotated, R C R^T, and propagated through J's last three columns.
        for a in range(3):
            for b in range(3):
                M[a, b] = J[a, 3] * R[0, b] + J[a, 4] * R[1, b] + J[a, 5] * R[2, b]
        for a in range(3):
            for b in range(a + 1):
                total = 0.0
                for k in range(3):
                    for l in range(3):  # noqa: E741
                        total += M[a, k] * covariance[i, k, l] * M[b, l]
                C[a, b] = total
        s00, s11 = C[0, 0] + variance[i, 0], C[1, 1] + variance[i, 1]
        s22, s01, s02, s12 = C[2, 2] + variance[i, 2], C[1, 0], C[2, 0], C[2, 1]
        sigma[i, 0], sigma[i, 1], sigma[i, 2] = math.sqrt(s00), math.sqrt(s11), math.sqrt(s22)
        if seen[i, 2] != seen[i, 2]:
            s22 += _UNKNOWN
        # Cholesky's factor and its inverse.
        i0 = 1.0 / sigma[i, 0]
        l10, l20 = s01 * i0, s02 * i0
        i1 = 1.0 / math.sqrt(s11 - l10 * l10)
        l21 = (s12 - l20 * l10) * i1
        i2 = 1.0 / math.sqrt(s22 - l20 * l20 - l21 * l21)
        factor[i, 0], factor[i, 2], factor[i, 5] = i0, i1, i2
        factor[i, 1] = -l10 * i0 * i1
        factor[i, 3] = (l10 * i1 * l21 - l20) * i0 * i2
        factor[i, 4] = -l21 * i1 * i2
        for k in range(6):
            usable[i] = usable[i] and math.isfinite(factor[i, k])
        for k in range(6):
            jacobian[i, 0, k] = J[0, k] * i0
            jacobian[i, 1, k] = J[0, k] * factor[i, 1] + J[1, k] * i1
            jacobian[i, 2, k] = J[0, k] * factor[i, 3] + J[1, k] * factor[i, 4] + J[2, k] * i2


@part
def _judge(
    place: Reals,
    seen: Reals,
    R: Reals,
    t: Reals,
    camera: Camera,
    threshold: float,
    most: float,
    sigma: Reals,
    factor: Reals,
    usable: Flags,
    white: Reals,
    length: Reals,
    inlier: Flags,
) -> int:
    """Write whitened residuals white (N, 3), lengths (N,) and inliers (N,); return their number."""
    r = np.empty(3)
    count = 0
    for i in range(len(place)):
        inlier[i] = False
        length[i] = np.inf
        white[i, 0] = white[i, 1] = white[i, 2] = 0.0
        if not usable[i]:
            continue
        _, _, z = _residual(place, seen, R, t, camera, i, r)
        if not z > 0.0:
            continue
        white[i, 0] = r[0] * factor[i, 0]
        white[i, 1] = r[0] * factor[i, 1] + r[1] * factor[i, 2]
        white[i, 2] = r[0] * factor[i, 3] + r[1] * factor[i, 4] + r[2] * factor[i, 5]
        square = white[i, 0] ** 2 + white[i, 1] ** 2 + white[i, 2] ** 2
        length[i] = math.sqrt(square)
        # Within the threshold, with v and disparity scaled to the noise of u.
        b, c = r[1] * sigma[i, 0] / sigma[i, 1], r[2] * sigma[i, 0] / sigma[i, 2]
        inlier[i] = r[0] * r[0] + b * b + c * c <= threshold * threshold and length[i] <= most
        count += inlier[i]
    return count


@part
def _cost(
    place: Reals,
    seen: Reals,
    R: Reals,
    t: Reals,
    camera: Camera,
    judges: Indices,
    sigma: Reals,
    cap: Reals,
    weight: Reals,
) -> tuple[float, float]:
    """Return the cost of a pose, and the weight of the points it explains.

    An outlier costs as much as the worst inlier (MSAC; Torr, Zisserman 2000); points without a
    finite cap do not count.
    """
    r = np.empty(3)
    cost = explained = 0.0
    for k in range(len(judges)):
        i = judges[k]
        if not math.isfinite(cap[k]):
            continue
        _, _, z = _residual(place, seen, R, t, camera, i, r)
        square = np.inf
        if z > 0.0:
            square = (r[0] / sigma[i, 0]) ** 2 + (r[1] / sigma[i, 1]) ** 2
            square += (r[2] / sigma[i, 2]) ** 2
        if square <= cap[k]:
            cost += square * weight[i]
            explained += weight[i]
        else:
            cost += cap[k] * weight[i]
    return cost, explained


@part
def _fit_sample(
    place: Reals,
    seen: Reals,
    variance: Reals,
    sample: Indices,
    camera: Camera,
    steps: int,
    R: Reals,
    t: Reals,
) -> None:
    """Fit a pose to the points of a sample by Gauss-Newton steps."""
    J, r = np.empty((3, 6)), np.empty(3)
    A, b, step = np.empty((6, 6)), np.empty(6), np.empty(6)
    for _ in range(steps):
        clear(A, b)
        for n in range(len(sample)):
            i = sample[n]
            x, y, z = _residual(place, seen, R, t, camera, i, r)
            if not (z > 0.0 and math.isfinite(x + y + z)):
                return
            _jacobian(x, y, z, camera, J)
            for row in range(3):
                if row == 2 and seen[i, 2] != seen[i, 2]:
                    continue
                w = 1.0 / variance[i, row]
                for k in range(6):
                    b[k] += J[row, k] * r[row] * w
                    for m in range(k + 1):
                        A[k, m] += J[row, k] * J[row, m] * w
        for k in range(6):
            A[k, k] += _DAMPING + 1e-6 * A[k, k]
        solved(A, b, step)
        for k in range(6):
            step[k] = min(max(step[k], -_LARGEST_SAMPLE_STEP), _LARGEST_SAMPLE_STEP)
        turned(step, R, t)


@part
def _first_from(rising: Reals, count: int, value: float) -> int:
    """Return the index of the first of ``count`` rising numbers >= a value; else the last."""
    low, high = 0, count - 1
    while low < high:
        middle = (low + high) // 2
        if rising[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@part
def _samples(share: float) -> float:
    """Return the number of samples needed to draw one without outliers, almost surely."""
    if not share > 0.0:
        return np.inf
    return math.log(1.0 - _CONFIDENCE) / math.log1p(-min(share**_SAMPLE, 1.0 - 1e-9))


@part
def _ransac(
    place: Reals,
    seen: Reals,
    variance: Reals,
    share: Reals,
    sigma: Reals,
    R: Reals,
    t: Reals,
    camera: Camera,
    threshold: float,
    iterations: int,
    chances: Reals,
) -> None:
    """Replace a pose by a better one, if a sample of three points gives one.

    As in libviso2 (Geiger et al., StereoScan, 2011): a sample of three points with disparity is
    solved by a few Gauss-Newton steps from the expected pose, which is a candidate itself.
    """
    count = len(place)
    # Drawn by weight, so that a dense cluster of points on an obstacle is not drawn too often.
    deep, drawn, total = np.empty(count, np.int64), np.empty(count), 0.0
    found = 0
    for i in range(count):
        if seen[i, 2] == seen[i, 2]:
            total += share[i]
            deep[found], drawn[found] = i, total
            found += 1
    if found < _SAMPLE:
        return
    number = min(_JUDGES, count)
    judges, cap, whole = np.empty(number, np.int64), np.empty(number), 0.0
    for k in range(number):
        i = int(k * (count - 1) / max(number - 1, 1))
        judges[k] = i
        cap[k] = (min(threshold, _OUTLIER_SIGMAS * sigma[i, 0]) / sigma[i, 0]) ** 2
        whole += share[i]
    best, explained = _cost(place, seen, R, t, camera, judges, sigma, cap, share)
    near = explained >= _EXPECTED_SHARE * whole
    batch, steps = (_NEAR_BATCH, _NEAR_STEPS) if near else (_BATCH, _SAMPLE_STEPS)
    wanted = min(float(iterations), _samples(explained / max(whole, 1e-9)))
    start_R, start_t = np.empty((3, 3)), np.empty(3)
    copy_pose(R, t, start_R, start_t)
    other_R, other_t = np.empty((3, 3)), np.empty(3)
    sample = np.empty(_SAMPLE, np.int64)
    tried = 0
    while tried < wanted and tried < len(chances):
        better = False
        for n in range(tried, min(tried + batch, len(chances))):
            for k in range(_SAMPLE):
                sample[k] = deep[_first_from(drawn, found, chances[n, k] * total)]
            copy_pose(start_R, start_t, other_R, other_t)
            _fit_sample(place, seen, variance, sample, camera, steps, other_R, other_t)
            cost, weight = _cost(place, seen, other_R, other_t, camera, judges, sigma, cap, share)
            if cost < best:
                best, explained, better = cost, weight, True
                copy_pose(other_R, other_t, R, t)
        tried += batch
        if better:
            wanted = min(wanted, _samples(explained / max(whole, 1e-9)))


@kernel(
    REALS2, REALS3, REALS2, REALS2, REALS1, REALS2, REALS1, CAMERA, REAL, WHOLE, WHOLE, REALS2
)  # fmt: skip
def fit_pose(
    place: Reals,
    covariance: Reals,
    seen: Reals,
    variance: Reals,
    share: Reals,
    rotation: Reals,
    translation: Reals,
    camera: Camera,
    threshold: float,
    min_inliers: int,
    iterations: int,
    chances: Reals,
) -> tuple[Reals, Reals, Reals, Flags, Reals]:
    """Find the pose T_camera_world that best explains where N points are seen.

    Args:
        place: (N, 3) metres, world. covariance: (N, 3, 3) m^2, of it.
        seen: (N, 3) pixels, u, v and disparity, NaN where it is unknown. variance: (N, 3) px^2.
        share: (N,) of the image that each point represents.
        rotation: (3, 3) and translation: (3,) metres, of the expected pose.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.
        threshold: pixels, for inliers.
        iterations: most samples of RANSAC. chances: (M, 3) random numbers from 0 to 1 for them.

    Returns:
        Rotation (3, 3), translation (3,), lengths (N,) of the residuals in standard deviations,
        which are inliers (N,), and the information (6, 6) of rotation and translation.
    """
    count = len(place)
    R, t = np.empty((3, 3)), np.empty(3)
    copy_pose(rotation, translation, R, t)
    sigma, factor = np.empty((count, 3)), np.empty((count, 6))
    jacobian, usable = np.empty((count, 3, 6)), np.empty(count, np.bool_)
    white, length, inlier = np.empty((count, 3)), np.empty(count), np.empty(count, np.bool_)
    _linearise(place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable)
    _ransac(place, seen, variance, share, sigma, R, t, camera, threshold, iterations, chances)
    _linearise(place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable)
    found = _judge(
        place, seen, R, t, camera, threshold, np.inf, sigma, factor, usable, white, length, inlier
    )
    information, A = np.empty((6, 6)), np.empty((6, 6))
    b, step = np.empty(6), np.empty(6)
    clear(information, b)
    for turn in range(_REFINE_STEPS):
        if found < min_inliers:
            break
        clear(information, b)
        for i in range(count):
            if not inlier[i]:
                continue
            # Huber's weight: large residuals that are not outliers count linearly.
            w = min(1.0, _HUBER_SIGMAS / max(length[i], 1e-9))
            for row in range(3):
                for k in range(6):
                    weighted = jacobian[i, row, k] * w
                    b[k] += weighted * white[i, row]
                    for m in range(k + 1):
                        information[k, m] += weighted * jacobian[i, row, m]
        for k in range(6):
            for m in range(k):
                information[m, k] = information[k, m]
        for k in range(6):
            for m in range(k + 1):
                A[k, m] = information[k, m]
            A[k, k] += _DAMPING * (1.0 + information[k, k])
        solved(A, b, step)
        for k in range(6):
            step[k] = min(max(step[k], -_LARGEST_STEP), _LARGEST_STEP)
        turned(step, R, t)
        if turn == 0:
            # Only once: from here on the pose changes too little to matter for the derivatives.
            _linearise(
                place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable
            )
        found = _judge(
            place,
            seen,
            R,
            t,
            camera,
            threshold,
            _OUTLIER_SIGMAS,
            sigma,
            factor,
            usable,
            white,
            length,
            inlier,
        )
        change = 0.0
        for k in range(6):
            for m in range(6):
                change += step[k] * information[k, m] * step[m]
        if turn > 0 and change < _CONVERGED**2:
            break
    return R, t, length, inlier, information
