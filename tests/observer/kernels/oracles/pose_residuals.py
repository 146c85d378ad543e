"""Oracle of ``observer.kernels.pose_residuals``: the same formulas for all points, by numpy.

Coordinates are in rows (3, N), so that each operation runs over contiguous memory: with a few
hundred points the number of numpy calls dominates the cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose

# px^2: variance of what was not seen, so that it does not count.
_UNKNOWN = 1e9
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


def _twice(R: Float64Array) -> Float64Array:
    """(6, 9) matrix from the entries of C (3, 3) to the distinct ones of R C R^T."""
    return np.asarray((R[_ROWS, :, None] * R[_COLUMNS, None, :]).reshape(6, 9))
