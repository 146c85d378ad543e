"""Convex polygons in front of a camera: clipping by depth, coverage of pixels.

A polygon is a list of corners ``(x, y, z, grow)`` in the camera frame, metres; ``grow`` belongs to
the edge from this corner to the next one: pixels by which the polygon is drawn beyond that edge,
because what adjoins there is drawn later and on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Corner = tuple[float, float, float, float]
Float32Array = NDArray[np.float32]


def clip_depth(polygon: list[Corner], depth: float, keep_far: bool, grow: float) -> list[Corner]:
    """The part with z >= depth (``keep_far``) or z <= depth; ``grow`` is of the cut edge.

    Sutherland and Hodgman, "Reentrant polygon clipping", 1974, for one plane.
    """
    result: list[Corner] = []
    n = len(polygon)
    for k in range(n):
        a, b = polygon[k], polygon[(k + 1) % n]
        a_in = (a[2] >= depth) == keep_far or a[2] == depth
        b_in = (b[2] >= depth) == keep_far or b[2] == depth
        if a_in:
            result.append(a)
        if a_in != b_in:
            f = (depth - a[2]) / (b[2] - a[2])
            edge = grow if a_in else a[3]
            result.append((a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), depth, edge))
    return result if len(result) >= 3 else []


def coverage(
    corners: list[tuple[float, float, float]], u0: int, v0: int, width: int, height: int
) -> Float32Array | None:
    """Share of each pixel of a window that a convex polygon covers; None where it covers all.

    Args:
        corners: ``(u, v, grow)`` pixels, either orientation.
        u0, v0: the window's first pixel. width, height: its size.

    The share is taken from the signed distance of the pixel's centre to the nearest edge, which
    is exact along straight edges of either axis and within a few per cent elsewhere.
    """
    n = len(corners)
    area = 0.0
    for k in range(n):
        a, b = corners[k], corners[(k + 1) % n]
        area += a[0] * b[1] - b[0] * a[1]
    side = 1.0 if area > 0 else -1.0
    us: Float32Array | None = None
    vs: Float32Array | None = None
    inside: Float32Array | None = None
    last_u, last_v = width - 1, height - 1
    for k in range(n):
        au, av, grow = corners[k]
        bu, bv, _ = corners[(k + 1) % n]
        du, dv = bu - au, bv - av
        length = (du * du + dv * dv) ** 0.5
        if length < 1e-9:
            continue
        nu, nv = -side * dv / length, side * du / length
        c = nu * (u0 - au) + nv * (v0 - av) + grow + 0.5
        if c + min(0.0, nu * last_u) + min(0.0, nv * last_v) >= 1:
            continue
        if us is None or vs is None:
            us = np.arange(width, dtype=np.float32)
            vs = np.arange(height, dtype=np.float32)[:, None]
        distance = us * np.float32(nu) + (vs * np.float32(nv) + np.float32(c))
        inside = distance if inside is None else np.minimum(inside, distance, out=inside)
    if inside is None:
        return None
    np.maximum(inside, 0, out=inside)
    return np.minimum(inside, 1, out=inside)
