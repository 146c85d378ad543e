"""Residuals of points of known places about a camera's pose, for both steps of its fit."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import Camera, Flags, Reals, part

# Variance, px^2, given to an unknown disparity, so that it does not count.
_UNKNOWN = 1e9
# Keeps the equations solvable where the points do not constrain a direction.
DAMPING = 1e-9
# Residuals beyond this many standard deviations are outliers.
OUTLIER_SIGMAS = 3.5


@part
def residual(
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
def differentiate(x: float, y: float, z: float, camera: Camera, J: Reals) -> None:
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
def linearise(
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
        x, y, z = residual(place, seen, R, t, camera, i, r)
        usable[i] = z > 0.0 and math.isfinite(x + y)
        if not usable[i]:
            sigma[i, 0] = sigma[i, 1] = sigma[i, 2] = np.nan
            continue
        differentiate(x, y, z, camera, J)
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
