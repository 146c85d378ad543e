"""Exact ray casting: depth, body and visible share.

Independent of the renderer: every ray is intersected with every facet in closed form. On the
plane n . p = d the inverse depth along the ray (x, y, 1) is n . (x, y, 1) / d.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.simulation.facets import Part
from observer.simulation.world import Body, World

# Body numbers of the room with its posters, and of a board that is held before the cameras.
ROOM = -1
BOARD = -2
# Rays per body and axis by which the visible share is measured.
_SHARE_RAYS = 48
_NEAR_M = 0.05


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays.

    Attributes:
        inverse_depth: (...) float64, 1/m along the camera's z; 0 where nothing is met.
        body: (...) int, ``Body.id``; ROOM for the room, BOARD for a board.
    """

    inverse_depth: Float64Array
    body: NDArray[np.int64]


def cast(world: World, T_camera_room: Pose, rays: Float64Array, time: float) -> Hits:
    """Cast rays (..., 2), given by their points on z = 1, from a camera."""
    room = (world.room, *(Part((poster,)) for poster in world.posters))
    found = [(ROOM, _nearest_inverse_depth(room, T_camera_room, rays))]
    for thing in world.bodies:
        T_camera_body = T_camera_room @ thing.T_room_body(time)
        found.append((thing.id, _inverse_depth(thing, T_camera_body, rays, time)))
    if world.board is not None:
        T_camera_board = T_camera_room @ world.T_room_board(time)
        board = _nearest_inverse_depth((world.board.part,), T_camera_board, rays)
        found.append((BOARD, board))
    inverse = np.zeros(rays.shape[:-1])
    body = np.full(rays.shape[:-1], ROOM, dtype=np.int64)
    for number, depth in found:
        nearer = depth > inverse
        inverse[nearer], body[nearer] = depth[nearer], number
    return Hits(inverse, body)


def _intersections(
    part: Part, T_camera_part: Pose, rays: Float64Array
) -> Iterator[tuple[NDArray[np.bool_], Float64Array]]:
    """Yield for each facet that faces the camera a mask of the rays that meet it, and 1/depth."""
    eye = T_camera_part.inverse().translation
    for index in np.flatnonzero(part.facing(eye) > 1e-9):
        facet = part.facets[index]
        points = T_camera_part.apply(facet.vertices)
        normal = T_camera_part.rotate(facet.normal)
        plane = normal / (normal @ points[0])
        # Planes through the eye and each edge; the inside is where the facet's middle is.
        edges = np.cross(points, np.roll(points, -1, axis=0))
        edges *= np.sign(edges @ points.mean(axis=0))[:, None]
        depth = _along(rays, plane)
        hit = depth > 0
        for edge in edges:
            hit &= _along(rays, edge) >= 0
        yield hit, depth


def _along(rays: Float64Array, vector: Float64Array) -> Float64Array:
    """Return (...) scalar products of the rays (x, y, 1) with a vector (3,)."""
    x, y, z = vector.tolist()
    return np.asarray(rays[..., 0] * x + (rays[..., 1] * y + z), dtype=np.float64)


def project(world: World, points: Float64Array) -> Float64Array:
    """Project points (..., 3) in the left frame to pixels (..., 2) of the left image as delivered.

    Points that are not in front of the camera give NaN.
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


def visible_share(world: World, body: Body, time: float) -> float:
    """Return the visible share of a body's silhouette in the left image.

    What lies outside the image or behind another body counts as not visible.
    """
    T_camera_room = world.T_room_left(time).inverse()
    T_camera_body = T_camera_room @ body.T_room_body(time)
    vertices = [f.vertices for part in body.parts for f in part.facets]
    if body.person is not None:
        vertices.append(body.person.corners(time))
    points = T_camera_body.apply(np.concatenate(vertices))
    if points[:, 2].max() <= _NEAR_M:
        return 0.0
    # Points beside or behind the camera project far outside; a bound keeps the window finite.
    xy = np.clip(points[:, :2] / np.maximum(points[:, 2:], _NEAR_M), -20, 20)
    low, high = xy.min(axis=0), xy.max(axis=0)
    steps = (np.arange(_SHARE_RAYS) + 0.5) / _SHARE_RAYS
    x, y = (a + steps * (b - a) for a, b in zip(low, high, strict=True))
    rays = np.stack(np.meshgrid(x, y), axis=-1)
    own = _inverse_depth(body, T_camera_body, rays, time)
    covered = own > 0
    if not covered.any():
        return 0.0
    uv = project(world, np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1))
    c = world.true_calibration
    inside = ((uv >= -0.5) & (uv <= np.array([c.width, c.height]) - 0.5)).all(axis=-1)
    seen = covered & inside
    if not seen.any():
        return 0.0
    blocked = np.zeros_like(own)
    for other in world.bodies:
        if other is not body:
            T_camera_other = T_camera_room @ other.T_room_body(time)
            depth = _inverse_depth(other, T_camera_other, rays, time, (low, high))
            np.maximum(blocked, depth, out=blocked)
    if world.board is not None:
        T_camera_board = T_camera_room @ world.T_room_board(time)
        depth = _nearest_inverse_depth((world.board.part,), T_camera_board, rays)
        np.maximum(blocked, depth, out=blocked)
    seen &= own >= blocked
    return float(seen.sum() / covered.sum())


def _inverse_depth(
    body: Body,
    T_camera_body: Pose,
    rays: Float64Array,
    time: float,
    window: tuple[Float64Array, Float64Array] | None = None,
) -> Float64Array:
    """Return (...) 1/m where rays first meet a body; 0 where they do not.

    Args:
        window: (2,) least and (2,) largest of the rays; what lies beside it is not computed.
    """
    parts = body.parts
    if window is not None:
        parts = tuple(part for part in parts if not _apart(part, T_camera_body, *window))
    nearest = _nearest_inverse_depth(parts, T_camera_body, rays)
    if body.person is not None:
        np.maximum(nearest, body.person.inverse_depth(T_camera_body, rays, time), out=nearest)
    return nearest


def _nearest_inverse_depth(
    parts: Iterable[Part], T_camera_parts: Pose, rays: Float64Array
) -> Float64Array:
    """Return (...) 1/m of the first intersections with parts that share one frame; 0 without."""
    nearest = np.zeros(rays.shape[:-1])
    for part in parts:
        for hit, depth in _intersections(part, T_camera_parts, rays):
            np.maximum(nearest, depth, out=nearest, where=hit)
    return nearest


def _apart(part: Part, T_camera_part: Pose, low: Float64Array, high: Float64Array) -> bool:
    """True if a part's bounding sphere surely lies outside a window on z = 1."""
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
