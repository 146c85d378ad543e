"""Arrays for drawing: pure geometry, independent of viser.

All are in the world frame, metres, unless a name says otherwise. Layers have a fixed number of
elements (``padded``), because only then does a viewer's browser reuse its buffers.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.geometry import BOX_CORNERS, Float64Array, Pose
from observer.mount import CameraMount

# Pairs of a box's corners that form its edges.
_EDGES = np.array(
    [(a, b) for a, b in combinations(range(8), 2) if (BOX_CORNERS[a] != BOX_CORNERS[b]).sum() == 1]
)
EDGES_OF_A_BOX = len(_EDGES)
# Half the axle and the line ahead, as for a small robot that usually carries such cameras.
_HALF_AXLE_M, _AHEAD_M = 0.17, 0.3


def rig_edges(mount: CameraMount | None, T_world_camera: Pose | None) -> Float64Array:
    """Return lines (N, 2, 3) in the world that show the camera's position on its robot.

    They lead from the camera down to the floor, from there to the middle of the axle, along the
    axle, and in the driving direction; without the offset from the axle only the first. Empty if
    nothing is known.
    """
    if mount is None or T_world_camera is None:
        return np.zeros((0, 2, 3))
    T_base_camera = mount.T_base_camera
    camera = T_base_camera.translation
    foot = camera * (1, 1, 0)
    lines = [(camera, foot)]
    if mount.forward_m is not None and mount.left_m is not None:
        axle = np.array([0.0, _HALF_AXLE_M, 0.0])
        ahead = np.array([_AHEAD_M, 0.0, 0.0])
        lines += [(foot, np.zeros(3)), (axle, -axle), (np.zeros(3), ahead)]
    T_world_base = T_world_camera @ T_base_camera.inverse()
    return T_world_base.apply(np.array(lines).reshape(-1, 3)).reshape(-1, 2, 3)


def box_edges(center: ArrayLike, size: ArrayLike, rotation: ArrayLike) -> Float64Array:
    """Return the 12 edges (12, 2, 3) of a box.

    Args:
        size: (3,) extent along the box's own axes.
        rotation: (3, 3) box axes in the world.
    """
    half = np.asarray(size, dtype=np.float64) / 2
    corners = (BOX_CORNERS * half) @ np.asarray(rotation).T + np.asarray(center)
    return np.asarray(corners[_EDGES], dtype=np.float64)


def upright_rotation(yaw: float, up: Float64Array) -> Float64Array:
    """Return (3, 3) axes of a body standing on the floor: columns ahead, left, up in the world.

    Args:
        yaw: heading in the world's x-z plane, 0 along z and positive to the right (``TrueBody``).
        up: (3,) unit vector in the world.
    """
    ahead = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up], axis=1)


def uprighted(rotation: Float64Array, up: Float64Array) -> Float64Array:
    """Return (3, 3) axes of a body's box (across, down, along) turned so that it stands upright.

    The world is the camera's first view, which may look down or up; bodies stand on the floor.

    Args:
        rotation: (3, 3) box axes in the world. up: (3,) unit vector in the world.
    """
    along = rotation[:, 2] - (rotation[:, 2] @ up) * up
    along /= np.linalg.norm(along)
    return np.stack([np.cross(-up, along), -up, along], axis=1)


def trail_segments(positions: Sequence[ArrayLike]) -> Float64Array:
    """Return (N - 1, 2, 3) lines through N positions."""
    points = np.array(positions, dtype=np.float64).reshape(-1, 3)
    return np.stack([points[:-1], points[1:]], axis=1)


def floor_lines(half_width_m: int) -> Float64Array:
    """Return (N, 2, 3) lines of a grid of 1 m on z = 0 around the origin, along x and along y."""
    at = np.arange(-half_width_m, half_width_m + 1.0)
    far = np.full_like(at, half_width_m)
    zero = np.zeros_like(at)
    along_x = np.stack([np.stack([-far, at, zero], 1), np.stack([far, at, zero], 1)], axis=1)
    return np.concatenate([along_x, along_x[..., [1, 0, 2]]])


def padded(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """Return exactly ``count`` rows; if there are fewer, the last one is repeated, invisibly."""
    if len(rows) >= count:
        return rows[:count]
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])


def linear_rgb(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return sRGB colours (N, 3) without their gamma.

    Viser's client applies it to colours of single vertices, but not to a node's only colour.
    """
    part = colors / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return np.round(255 * linear).astype(np.uint8)


def thinned(count: int, most: int) -> slice:
    """Return every k-th of ``count`` rows, evenly spread, so that at most ``most`` remain."""
    return slice(None, None, max(1, -(-count // most)))


class Follower:
    """Follower that keeps the robot in view: the scene moves once it is beyond ``radius_m``.

    Within the radius nothing moves, so that the motion of a robot in a room is visible.
    """

    def __init__(self, radius_m: float = 4.0) -> None:
        self._radius = radius_m
        self._anchor = np.zeros(2)

    def reset(self) -> None:
        self._anchor = np.zeros(2)

    def offset(self, position_display: Float64Array) -> Float64Array:
        """Return the (3,) shift of the display; horizontal only."""
        away = position_display[:2] - self._anchor
        distance = float(np.linalg.norm(away))
        if distance > self._radius:
            self._anchor = self._anchor + away * (1 - self._radius / distance)
        return np.array([-self._anchor[0], -self._anchor[1], 0.0])
