"""Projection of all facets of a body at once: visibility, place in the image, texture mapping.

Done facet by facet, this arithmetic would dominate rendering time; here it takes a few array
operations for all facets of a body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array, cross_matrix
from observer.simulation.facets import Part, sphere_around
from observer.simulation.polygons import Corner, ImageCorner

Window = tuple[int, int, int, int]


@dataclass(frozen=True)
class View:
    """A pinhole camera's image.

    Attributes:
        width, height: of the whole image, pixels. fx, fy, cx, cy: pixels; (0, 0) is the centre
            of the first pixel.
        rows: the range of rows to draw; all of them unless there is a rolling shutter.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    rows: tuple[int, int]

    def window(self, low_u: float, low_v: float, high_u: float, high_v: float) -> Window | None:
        """Return first and past-the-end pixel between the given bounds; None outside the image."""
        first, last = self.rows
        if high_u < -1 or high_v < first - 1 or low_u > self.width or low_v > last:
            return None
        u0 = max(0, math.floor(low_u - 1)) if low_u > 0 else 0
        v0 = max(first, math.floor(low_v - 1)) if low_v > first else first
        u1 = min(self.width, math.ceil(high_u + 1) + 1) if high_u < self.width else self.width
        v1 = min(last, math.ceil(high_v + 1) + 1) if high_v < last else last
        return (u0, v0, u1, v1) if u1 > u0 and v1 > v0 else None


@dataclass(frozen=True, eq=False)
class SeenFacet:
    """A facet that may be in the image.

    Attributes:
        corners: camera frame, with each edge's ``grow``, see ``polygons``.
        image_corners: their pixels; meaningless unless ``nearest`` is in front of the camera.
        bounds: u0, v0, u1, v1 of these pixels.
        nearest, farthest: smallest and largest z of the corners, metres.
        texture_from_image: nine numbers, row by row: from a pixel (u, v, 1) to (s, t, 1) / z,
            metres on the texture and inverse depth.
    """

    corners: list[Corner]
    image_corners: list[ImageCorner]
    bounds: list[float]
    nearest: float
    farthest: float
    texture_from_image: list[float]


class FacetBatch:
    """The facets of several parts that share one frame."""

    def __init__(self, parts: Sequence[Part]) -> None:
        facets = [facet for part in parts for facet in part.facets]
        self.starts = np.cumsum([0, *(len(part.facets) for part in parts)]).tolist()
        counts = [len(f.vertices) for f in facets]
        self._firsts = np.cumsum([0, *counts[:-1]])
        self._ends = np.cumsum(counts).tolist()
        self._vertices = np.concatenate([f.vertices for f in facets])
        self._centre, self._radius = sphere_around(self._vertices)
        own = np.repeat(np.arange(len(facets)), counts)
        neighbours = []
        for part, start in zip(parts, self.starts, strict=False):
            for f in part.facets:
                neighbours += [-1 if n is None else n + start for n in f.neighbours]
        self._neighbours = np.array(neighbours)
        self._drawn_later = self._neighbours > own
        along = np.array([f.along for f in facets])
        down = np.array([f.down for f in facets])
        origin = np.array([f.origin for f in facets])
        # With o' = origin - eye, the inverse of [along down o'] has the rows
        # down x o' / D, o' x along / D, along x down / D, where D = o' . (along x down).
        self._down_origin = np.cross(down, origin)
        self._origin_along = np.cross(origin, along)
        self._along_down = np.cross(along, down)
        self._cross_down = cross_matrix(down)
        self._cross_along = cross_matrix(along)
        self._offsets = np.einsum("ij,ij->i", self._along_down, origin)

    def outside(self, R: Float64Array, t: Float64Array, view: View) -> bool:
        """True if the bounding sphere lies outside the view, given ``T_camera_frame``."""
        x, y, z = (R @ self._centre + t).tolist()
        r = self._radius
        if z < -r:
            return True
        left, right = (view.cx + 1) / view.fx, (view.width - view.cx) / view.fx
        above, below = view.cy - view.rows[0] + 1, view.rows[1] - view.cy
        above, below = above / view.fy, below / view.fy
        return bool(
            x + left * z < -r * math.hypot(1, left)
            or right * z - x < -r * math.hypot(1, right)
            or y + above * z < -r * math.hypot(1, above)
            or below * z - y < -r * math.hypot(1, below)
        )

    def seen(
        self, R: Float64Array, t: Float64Array, eye: Float64Array, view: View, near: float
    ) -> list[SeenFacet | None]:
        """Return the facets that may be in the image, in order; None for those that are not.

        Args:
            R, t: ``T_camera_frame``. eye: (3,) camera centre in the facets' frame, metres.
            near: metres in front of the camera within which nothing is drawn.
        """
        determinant = self._offsets - self._along_down @ eye
        # down x along is the normal, so a facet faces the eye where D > 0.
        facing = determinant > 1e-6
        count = len(facing)
        if not facing.any():
            return [None] * count
        points = self._vertices @ R.T + t
        z = points[:, 2]
        safe = np.maximum(z, near)
        uv = points[:, :2] / safe[:, None] * (view.fx, view.fy) + (view.cx, view.cy)
        low = np.minimum.reduceat(uv, self._firsts)
        high = np.maximum.reduceat(uv, self._firsts)
        nearest = np.minimum.reduceat(z, self._firsts)
        farthest = np.maximum.reduceat(z, self._firsts)
        first, last = view.rows
        drawn = facing & (farthest > near)
        drawn &= (nearest < near) | (
            (high[:, 0] > -1)
            & (low[:, 0] < view.width)
            & (high[:, 1] > first - 1)
            & (low[:, 1] < last)
        )
        chosen = np.flatnonzero(drawn).tolist()
        if not chosen:
            return [None] * count
        grow = (self._drawn_later & facing[self._neighbours]).astype(np.float64)
        rows = np.empty((count, 3, 3))
        rows[:, 0] = self._down_origin - self._cross_down @ eye
        rows[:, 1] = self._origin_along + self._cross_along @ eye
        rows[:, 2] = self._along_down
        with np.errstate(divide="ignore", invalid="ignore"):
            rows /= determinant[:, None, None]
        across, down = [1 / view.fx, 0, -view.cx / view.fx], [0, 1 / view.fy, -view.cy / view.fy]
        rays = R.T @ np.array([across, down, [0, 0, 1.0]])
        inverse = (rows @ rays).reshape(count, 9).tolist()
        corners = np.column_stack([points, grow]).tolist()
        image_corners = np.column_stack([uv, grow]).tolist()
        bounds = np.column_stack([low, high]).tolist()
        near_list, far_list = nearest.tolist(), farthest.tolist()
        result: list[SeenFacet | None] = [None] * count
        for k in chosen:
            a, b = int(self._firsts[k]), self._ends[k]
            result[k] = SeenFacet(
                corners[a:b], image_corners[a:b], bounds[k], near_list[k], far_list[k], inverse[k]
            )
        return result
