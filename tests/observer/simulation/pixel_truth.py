"""True depth, body and flow of every pixel of the left image as delivered (global shutter)."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.imaging import undistorted_rays
from observer.simulation.visibility import BOARD, Hits, cast, project
from observer.simulation.world import World


def left_rays(world: World) -> Float64Array:
    """Return the rays (H, W, 2) of the left image's pixels before rectification."""
    c = world.true_calibration
    return undistorted_rays(c.width, c.height, c.K1, c.D1)


def left_hits(world: World, time: float) -> Hits:
    """Return what the rays of the left image's pixels hit."""
    return cast(world, world.T_room_left(time).inverse(), left_rays(world), time)


def render_depth(world: World, time: float) -> Float64Array:
    """Return (H, W) metres along the left camera's z."""
    return np.asarray(1 / left_hits(world, time).inverse_depth, dtype=np.float64)


def true_flow(world: World, t0: float, t1: float) -> Float64Array:
    """Return the optical flow (H, W, 2) in pixels of the left image from t0 to t1.

    Points may be hidden or outside the image at t1; points behind the camera at t1 give NaN.
    """
    rays = left_rays(world)
    T_room_left = world.T_room_left(t0)
    hits = cast(world, T_room_left.inverse(), rays, t0)
    depth = 1 / hits.inverse_depth
    points = np.concatenate([rays, np.ones((*depth.shape, 1))], axis=-1) * depth[..., None]
    points = T_room_left.apply(points)
    for body in world.bodies:
        mask = hits.body == body.id
        if mask.any():
            motion = body.T_room_body(t1) @ body.T_room_body(t0).inverse()
            points[mask] = motion.apply(points[mask])
    if world.board is not None:
        mask = hits.body == BOARD
        motion = world.T_room_board(t1) @ world.T_room_board(t0).inverse()
        points[mask] = motion.apply(points[mask])
    seen = world.T_room_left(t1).inverse().apply(points)
    height, width = depth.shape
    start = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    return project(world, seen) - start
