"""Ellipsoids before a pinhole camera: outline, depth and normals in closed form.

The camera ray s r, r = (x, y, 1), meets an ellipsoid with centre c, axes M (columns) and semi-axes
a where |A (s r - c)| = 1 with A = diag(1/a) M^T. With o = -A c and d = A r this is

    (d . d) s^2 + 2 (o . d) s + (o . o - 1) = 0,

whose discriminant is a quadratic form of the ray: the outline in the image is a conic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.polygons import FloatArray

_NEAR_M = 0.05


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """L ellipsoids in one frame.

    Attributes:
        centres: (L, 3) metres. axes: (L, 3, 3), columns are unit vectors along the semi-axes.
        semi: (L, 3) semi-axes, metres.
    """

    centres: Float64Array
    axes: Float64Array
    semi: Float64Array

    def moved(self, R: Float64Array, t: Float64Array) -> Ellipsoids:
        """Return them in another frame, given ``R``, ``t`` of ``T_target_frame``."""
        return Ellipsoids(self.centres @ R.T + t, R @ self.axes, self.semi)


@dataclass(frozen=True, eq=False)
class Silhouette:
    """One ellipsoid as a camera sees it; matrices as in the formulas above.

    Attributes:
        A: (3, 3) and o: (3,). N: (3, 3); the discriminant is r^T N r.
        bounds: smallest x and y, largest x and y on z = 1; infinite if it reaches the eye.
        depth: z of its centre, metres.
    """

    A: Float64Array
    o: Float64Array
    N: Float64Array
    bounds: tuple[float, float, float, float]
    depth: float

    def meet(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Intersect rays (x, y, 1), given on z = 1; ``x`` and ``y`` are broadcast.

        Returns:
            (...) discriminant, negative outside the outline, and (...) inverse depth, 1/m, of the
            nearer intersection or, outside the outline, of the ray's nearest point. It is not
            positive behind the camera.
        """
        (n00, n01, n02), (_, n11, n12), (_, _, n22) = self.N.tolist()
        disc = (n00 * x + 2 * (n01 * y + n02)) * x + ((n11 * y + 2 * n12) * y + n22)
        qx, qy, qz = (-(self.A.T @ self.o)).tolist()
        towards = qx * x + (qy * y + qz)
        # The nearer of the two roots is (o . o - 1) / (towards + root).
        outside = float(self.o @ self.o) - 1
        if outside <= 0:
            return np.full_like(disc, -1.0), np.zeros_like(disc)
        return disc, (towards + np.sqrt(np.maximum(disc, 0.0))) / outside

    def apart(self, low: Float64Array, high: Float64Array) -> bool:
        """Return True if it lies outside a window on z = 1, given by its corners (2,) x, y."""
        x0, y0, x1, y1 = self.bounds
        return bool(x1 < low[0] or x0 > high[0] or y1 < low[1] or y0 > high[1])


def silhouettes(seen: Ellipsoids) -> list[Silhouette | None]:
    """Return each ellipsoid's outline; None for those behind the camera. ``seen``: camera frame."""
    found: list[Silhouette | None] = []
    for c, M, a in zip(seen.centres, seen.axes, seen.semi, strict=True):
        reach = math.sqrt(float((M[2] * a) @ (M[2] * a)))
        if c[2] + reach <= _NEAR_M:
            found.append(None)
            continue
        A = M.T / a[:, None]
        o = -A @ c
        Q, q = A.T @ A, A.T @ o
        N = np.outer(q, q) - (float(o @ o) - 1) * Q
        found.append(Silhouette(A, o, N, _bounds(c, M * a, reach), float(c[2])))
    return found


def _bounds(
    c: Float64Array, scaled: Float64Array, reach: float
) -> tuple[float, float, float, float]:
    """Bounds of the outline on z = 1, from its dual conic c c^T - (M a) (M a)^T."""
    if c[2] - reach <= _NEAR_M:
        return -math.inf, -math.inf, math.inf, math.inf
    dual = np.outer(c, c) - scaled @ scaled.T
    ends = []
    for k in (0, 1):
        root = math.sqrt(max(0.0, float(dual[k, 2] ** 2 - dual[k, k] * dual[2, 2])))
        ends.append(((dual[k, 2] - root) / dual[2, 2], (dual[k, 2] + root) / dual[2, 2]))
    (x0, x1), (y0, y1) = ends
    return float(x0), float(y0), float(x1), float(y1)
