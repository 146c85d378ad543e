"""Convex polygons in front of a camera: clipping by depth, coverage of pixels.

A polygon is a list of corners ``[x, y, z, grow]`` in the camera frame, metres. ``grow`` belongs to
the edge from this corner to the next one: the polygon is drawn this many pixels beyond that edge,
because its neighbour there is drawn later and on top.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Corner = Sequence[float]
# u, v, grow: pixels.
ImageCorner = Sequence[float]
Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.floating[Any]]

# Up to this many values, computing the distances to all edges at once is faster.
_AT_ONCE = 12000


def clip_depth(polygon: list[Corner], depth: float, keep_far: bool, grow: float) -> list[Corner]:
    """Return the part with z >= depth (``keep_far``) or z <= depth; the cut edge gets ``grow``.

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
    corners: list[ImageCorner], u0: int, v0: int, width: int, height: int
) -> Float32Array | None:
    """Return the share of each pixel in a window that a convex polygon covers; None if it is all.

    Args:
        corners: pixels, either orientation.
        u0, v0: the window's first pixel. width, height: its size.

    The share is computed from the signed distance of the pixel's centre to the nearest edge, which
    is exact for axis-parallel edges and within a few per cent otherwise.
    """
    edges = _edges(corners, u0, v0, width - 1, height - 1)
    if not edges:
        return None
    us = np.arange(width, dtype=np.float32)
    vs = np.arange(height, dtype=np.float32)[:, None]
    if len(edges) * width * height <= _AT_ONCE:
        e = np.array(edges, dtype=np.float32)[:, :, None, None]
        inside: Float32Array = (e[:, 0] * us + (e[:, 1] * vs + e[:, 2])).min(axis=0)
    else:
        for k, (nu, nv, c) in enumerate(edges):
            distance = us * np.float32(nu) + (vs * np.float32(nv) + np.float32(c))
            inside = distance if k == 0 else np.minimum(inside, distance, out=inside)
    np.maximum(inside, 0, out=inside)
    return np.minimum(inside, 1, out=inside)


def _edges(
    corners: list[ImageCorner], u0: int, v0: int, last_u: int, last_v: int
) -> list[tuple[float, float, float]]:
    """Return (nu, nv, c) of every edge that limits coverage, nu u + nv v + c, in the window."""
    n = len(corners)
    area = 0.0
    au, av = corners[n - 1][0], corners[n - 1][1]
    for bu, bv, _ in corners:
        area += au * bv - bu * av
        au, av = bu, bv
    side = 1.0 if area > 0 else -1.0
    edges = []
    for k in range(n):
        au, av, grow = corners[k]
        bu, bv, _ = corners[k + 1 if k + 1 < n else 0]
        du, dv = bu - au, bv - av
        length = (du * du + dv * dv) ** 0.5
        if length < 1e-9:
            continue
        nu, nv = -side * dv / length, side * du / length
        c = nu * (u0 - au) + nv * (v0 - av) + grow + 0.5
        least = c
        if nu < 0:
            least += nu * last_u
        if nv < 0:
            least += nv * last_v
        if least < 1:
            edges.append((nu, nv, c))
    return edges
