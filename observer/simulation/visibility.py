"""Exact ray casting: depth, body, and the visible part of each body.

It is independent of the renderer: every ray is intersected with every facet in closed form. On the
plane n . p = d the inverse depth along the ray (x, y, 1) is n . (x, y, 1) / d.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.simulation.facets import Facet, Part
from observer.simulation.people.ellipsoids import Silhouette, silhouettes
from observer.simulation.world import Body, World
from observer.types import BoxPx

# Body ids of the room with its posters, and of a board held before the cameras.
ROOM = -1
BOARD = -2
# Rays across a body along each axis, used to measure its visible part.
_PART_RAYS = 48
_NEAR_M = 0.05


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays.

    Attributes:
        inverse_depth: (...) float64, 1/m along the camera's z; 0 where nothing is hit.
        body: (...) int, ``Body.id``; ROOM for the room, BOARD for a board.
    """

    inverse_depth: Float64Array
    body: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class VisiblePart:
    """Part of a body that the left camera sees past other bodies that occlude it.

    Attributes:
        share: of its silhouette that is visible in the left image as delivered, 0 to 1.
        box_px: around what is visible in the rectified left image; None if nothing is.
    """

    share: float
    box_px: BoxPx | None


_NOTHING = VisiblePart(0.0, None)


def cast(world: World, T_camera_room: Pose, rays: Float64Array, time: float) -> Hits:
    """Cast rays (..., 2) from a camera, given by their points on z = 1."""
    room = (world.room, *(Part((poster,)) for poster in world.posters))
    found = [(ROOM, _nearest_inverse_depth(room, T_camera_room, rays))]
    for thing in world.bodies:
        seen = _SeenBody.of(thing, T_camera_room, time)
        found.append((thing.id, seen.inverse_depth(rays)))
    if world.board is not None:
        found.append((BOARD, _board_inverse_depth(world, T_camera_room, rays, time)))
    inverse = np.zeros(rays.shape[:-1])
    body = np.full(rays.shape[:-1], ROOM, dtype=np.int64)
    for number, depth in found:
        nearer = depth > inverse
        inverse[nearer], body[nearer] = depth[nearer], number
    return Hits(inverse, body)


def _intersections(
    part: Part, T_camera_part: Pose, rays: Float64Array
) -> Iterator[tuple[NDArray[np.bool_], Float64Array]]:
    """Yield, for each facet that faces the camera, the mask of rays that hit it and 1/depth."""
    for facet in _facing(part, T_camera_part):
        points = T_camera_part.apply(facet.vertices)
        normal = T_camera_part.rotate(facet.normal)
        plane = normal / (normal @ points[0])
        # Planes through the eye and each edge, oriented so that the facet's middle is inside.
        edges = np.cross(points, np.roll(points, -1, axis=0))
        edges *= np.sign(edges @ points.mean(axis=0))[:, None]
        depth = _along(rays, plane)
        hit = depth > 0
        for edge in edges:
            hit &= _along(rays, edge) >= 0
        yield hit, depth


def _facing(part: Part, T_camera_part: Pose) -> list[Facet]:
    """Return the facets whose front faces the camera."""
    towards = part.facing(T_camera_part.inverse().translation)
    return [part.facets[index] for index in np.flatnonzero(towards > 1e-9)]


def _along(rays: Float64Array, vector: Float64Array) -> Float64Array:
    """Return (...) scalar products of the rays (x, y, 1) with a vector (3,)."""
    x, y, z = vector.tolist()
    return np.asarray(rays[..., 0] * x + (rays[..., 1] * y + z), dtype=np.float64)


def project(world: World, points: Float64Array) -> Float64Array:
    """Project points (..., 3) in the left frame to pixels (..., 2) of the left image as delivered.

    Points that are not in front of the camera become NaN.
    """
    c = world.true_calibration
    front = points[..., 2] > 1e-6
    safe = np.where(front[..., None], points, np.array([0.0, 0.0, 1.0]))
    if c.D1.any():
        flat = safe.reshape(-1, 1, 3)
        pixels = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), c.K1, c.D1)[0]
        uv = np.asarray(pixels, np.float64).reshape(*points.shape[:-1], 2)
    else:
        uv = safe[..., :2] / safe[..., 2:] * [c.K1[0, 0], c.K1[1, 1]] + c.K1[:2, 2]
    return np.where(front[..., None], uv, np.nan)


def visible_parts(world: World, time: float) -> dict[int, VisiblePart]:
    """Return what the left camera sees of each obstacle, by the obstacle's id."""
    T_left_camera = Pose(world.R_camera_left.T, np.zeros(3))
    T_camera_room = (world.T_room_left(time) @ T_left_camera).inverse()
    seen = {body.id: _SeenBody.of(body, T_camera_room, time) for body in world.bodies}
    parts = {}
    for body in world.obstacles:
        others = [other for number, other in seen.items() if number != body.id]
        parts[body.id] = _visible_part(world, T_camera_room, time, seen[body.id], others)
    return parts


def _visible_part(
    world: World, T_camera_room: Pose, time: float, body: _SeenBody, others: Iterable[_SeenBody]
) -> VisiblePart:
    """Cast rays at a body and at what may occlude it, in the ``camera`` frame."""
    window = body.window()
    # An empty window: at most an edge of the body is in front of the camera.
    if window is None or not (window[1] > window[0]).all():
        return _NOTHING
    x, y = _axes(world, *window)
    rays = np.stack(np.meshgrid(x.middles, y.middles), axis=-1)
    own = body.inverse_depth(rays)
    covered = own > 0
    if not covered.any():
        return _NOTHING
    delivered = _delivered(world, rays)
    inside = y.inside[:, None] & x.inside
    front = covered & (delivered | inside)
    if not front.any():
        return _NOTHING
    for other in others:
        front &= own >= other.inverse_depth(rays, window)
    if world.board is not None:
        front &= own >= _board_inverse_depth(world, T_camera_room, rays, time)
    area = y.shares[:, None] * x.shares
    share = float(area[front & delivered].sum() / area[covered].sum())
    return VisiblePart(share, _box(world, x, y, covered, front & inside))


def _delivered(world: World, rays: Float64Array) -> NDArray[np.bool_]:
    """Mask of the rays (..., 2), ``camera`` frame, that fall in the left image as delivered."""
    directions = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    uv = project(world, directions @ world.R_camera_left)
    c = world.true_calibration
    return np.asarray(((uv >= -0.5) & (uv <= np.array([c.width, c.height]) - 0.5)).all(axis=-1))


def _box(
    world: World, x: _Axis, y: _Axis, covered: NDArray[np.bool_], seen: NDArray[np.bool_]
) -> BoxPx | None:
    """Return the box around the visible cells among those (rows, columns) that a body covers."""
    if not seen.any():
        return None
    x0, x1 = x.extent(np.nonzero(covered)[1], np.nonzero(seen)[1])
    y0, y1 = y.extent(np.nonzero(covered)[0], np.nonzero(seen)[0])
    K, c = world.K_camera, world.true_calibration
    u = np.clip(np.array([x0, x1]) * K[0, 0] + K[0, 2], -0.5, c.width - 0.5)
    v = np.clip(np.array([y0, y1]) * K[1, 1] + K[1, 2], -0.5, c.height - 0.5)
    return float(u[0]), float(v[0]), float(u[1]), float(v[1])


@dataclass(frozen=True, eq=False)
class _Axis:
    """Cells along one axis of a body's window on z = 1.

    Attributes:
        edges: (N + 1,) and middles: (N,), ascending. shares: (N,) widths over the widest one.
        inside: (N,) True within the rectified image.
    """

    edges: Float64Array
    middles: Float64Array
    shares: Float64Array
    inside: NDArray[np.bool_]

    @staticmethod
    def across(low: float, high: float, first: float, last: float) -> _Axis:
        """Divide a window into cells, finer within the image, ``first`` to ``last``.

        No cell straddles the image border. Instead a cell of zero width lies on it, because a
        slanting limb reaches farther out at the border than half a cell inside it.
        """
        borders = [border for border in (first, last) if low < border < high]
        edges, inside = [np.array([low])], []
        for a, b in pairwise([low, *borders, high]):
            within = first <= a and b <= last
            count = _PART_RAYS if within else max(1, round(_PART_RAYS * (b - a) / (high - low)))
            ends = [a] * (within and a in borders) + [b] * (within and b in borders)
            cells = np.sort([*(a + np.arange(1, count + 1) / count * (b - a)), *ends])
            edges.append(cells)
            inside.append(np.full(len(cells), within))
        edge = np.concatenate(edges)
        width = np.diff(edge)
        middles = (edge[:-1] + edge[1:]) / 2
        return _Axis(edge, middles, width / width.max(), np.concatenate(inside))

    def extent(self, covered: NDArray[np.intp], seen: NDArray[np.intp]) -> tuple[float, float]:
        """Return where a body begins and ends, given the indices of covered and visible cells.

        If the body's outermost cell is visible, it extends to the end of the window, which fits
        tightly, since its tip may lie between two rays.
        """
        begin, end = seen.min(), seen.max() + 1
        if begin == covered.min():
            begin = 0
        if end == covered.max() + 1:
            end = len(self.middles)
        return float(self.edges[begin]), float(self.edges[end])


def _axes(world: World, low: Float64Array, high: Float64Array) -> tuple[_Axis, _Axis]:
    """Return the cells of a window on z = 1, given by its corners (2,), along x and y."""
    K, c = world.K_camera, world.true_calibration
    first = (-0.5 - K[:2, 2]) / K[[0, 1], [0, 1]]
    last = (np.array([c.width, c.height]) - 0.5 - K[:2, 2]) / K[[0, 1], [0, 1]]
    corners = np.stack([low, high, first, last], axis=1).tolist()
    return _Axis.across(*corners[0]), _Axis.across(*corners[1])


@dataclass(frozen=True, eq=False)
class _SeenBody:
    """A body in a camera's frame: its flat parts, and a person's ellipsoids."""

    parts: tuple[Part, ...]
    T_camera_body: Pose
    outlines: tuple[Silhouette, ...]

    @staticmethod
    def of(body: Body, T_camera_room: Pose, time: float) -> _SeenBody:
        T_camera_body = T_camera_room @ body.T_room_body(time)
        if body.person is None:
            return _SeenBody(body.parts, T_camera_body, ())
        outlines = silhouettes(body.person.seen(T_camera_body, time))
        return _SeenBody(body.parts, T_camera_body, tuple(o for o in outlines if o is not None))

    def window(self) -> tuple[Float64Array, Float64Array] | None:
        """Return smallest and largest x, y (2,) on z = 1; None if nothing faces the camera."""
        corners = [np.reshape(outline.bounds, (2, 2)) for outline in self.outlines]
        facets = [facet for part in self.parts for facet in _facing(part, self.T_camera_body)]
        if facets:
            points = self.T_camera_body.apply(np.concatenate([f.vertices for f in facets]))
            if points[:, 2].max() > _NEAR_M:
                corners.append(points[:, :2] / np.maximum(points[:, 2:], _NEAR_M))
        if not corners:
            return None
        # Points beside or behind the camera project far outside; clip to keep the window finite.
        xy = np.clip(np.concatenate(corners), -20, 20)
        return xy.min(axis=0), xy.max(axis=0)

    def inverse_depth(
        self, rays: Float64Array, window: tuple[Float64Array, Float64Array] | None = None
    ) -> Float64Array:
        """Return (...) 1/m where rays first hit the body; 0 where they miss it.

        Args:
            window: (2,) smallest and (2,) largest of the rays; parts outside it are skipped.
        """
        parts, outlines = self.parts, self.outlines
        if window is not None:
            parts = tuple(p for p in parts if not _apart(p, self.T_camera_body, *window))
            outlines = tuple(outline for outline in outlines if not outline.apart(*window))
        nearest = _nearest_inverse_depth(parts, self.T_camera_body, rays)
        for outline in outlines:
            disc, inverse = outline.meet(rays[..., 0], rays[..., 1])
            np.maximum(nearest, inverse, out=nearest, where=disc >= 0)
        return nearest


def _board_inverse_depth(
    world: World, T_camera_room: Pose, rays: Float64Array, time: float
) -> Float64Array:
    """Return (...) 1/m where rays hit the board held before the cameras; 0 beside it."""
    assert world.board is not None
    T_camera_board = T_camera_room @ world.T_room_board(time)
    return _nearest_inverse_depth((world.board.part,), T_camera_board, rays)


def _nearest_inverse_depth(
    parts: Iterable[Part], T_camera_parts: Pose, rays: Float64Array
) -> Float64Array:
    """Return (...) 1/m of the first intersections with parts that share a frame; 0 if none."""
    nearest = np.zeros(rays.shape[:-1])
    for part in parts:
        for hit, depth in _intersections(part, T_camera_parts, rays):
            np.maximum(nearest, depth, out=nearest, where=hit)
    return nearest


def _apart(part: Part, T_camera_part: Pose, low: Float64Array, high: Float64Array) -> bool:
    """True if a part's bounding sphere certainly lies outside a window on z = 1."""
    centre, reach = part.sphere
    x, y, z = T_camera_part.apply(centre)
    if z + reach <= 0:
        return True
    if z - reach <= _NEAR_M:
        return False
    near = z - reach
    return bool(
        max((x + reach) / near, (x + reach) / (z + reach)) < low[0]
        or min((x - reach) / near, (x - reach) / (z + reach)) > high[0]
        or max((y + reach) / near, (y + reach) / (z + reach)) < low[1]
        or min((y - reach) / near, (y - reach) / (z + reach)) > high[1]
    )
