"""RANSAC for a camera's pose: samples of three points, scored by many; see ``fit_pose``."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import Camera, Indices, Reals, part
from observer.kernels.pose_residuals import DAMPING, OUTLIER_SIGMAS, differentiate, residual
from observer.kernels.small import clear, copy_pose, solved, turned

_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
# Most points used to score a sample; more do not make the ranking more reliable.
_JUDGES = 200
# If the expected pose explains this share of the image, the best pose is near: then a few samples
# with one Gauss-Newton step each are enough.
_EXPECTED_SHARE = 0.6
_NEAR_BATCH, _NEAR_STEPS = 16, 1
# Limit of a step: three nearly collinear points leave a rotation undetermined; such samples lose,
# but must not overflow.
_LARGEST_STEP = 1e3


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
        _, _, z = residual(place, seen, R, t, camera, i, r)
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
            x, y, z = residual(place, seen, R, t, camera, i, r)
            if not (z > 0.0 and math.isfinite(x + y + z)):
                return
            differentiate(x, y, z, camera, J)
            for row in range(3):
                if row == 2 and seen[i, 2] != seen[i, 2]:
                    continue
                w = 1.0 / variance[i, row]
                for k in range(6):
                    b[k] += J[row, k] * r[row] * w
                    for m in range(k + 1):
                        A[k, m] += J[row, k] * J[row, m] * w
        for k in range(6):
            A[k, k] += DAMPING + 1e-6 * A[k, k]
        solved(A, b, step)
        for k in range(6):
            step[k] = min(max(step[k], -_LARGEST_STEP), _LARGEST_STEP)
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
def ransac(
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
        cap[k] = (min(threshold, OUTLIER_SIGMAS * sigma[i, 0]) / sigma[i, 0]) ** 2
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
