"""Arrays for what is drawn: pure geometry, nothing of viser.

Everything is given in the world frame, metres, unless a name says otherwise. Layers have a fixed
number of elements (``padded``), because a viewer's browser reuses its buffers only then.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.geometry import Float64Array, Pose

Float32Array = NDArray[np.float32]
Colors = NDArray[np.uint8]

# Camera axes (x right, y down, z forward) in display axes (x forward, y left, z up), level.
_LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# A box's corners in units of its half size, and the pairs of them that are its edges.
_CORNERS = np.array(
    [[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)], dtype=np.float64
)
_EDGES = np.array(
    [
        (a, b)
        for a in range(8)
        for b in range(a + 1, 8)
        if int((_CORNERS[a] != _CORNERS[b]).sum()) == 1
    ]
)
EDGES_OF_A_BOX = len(_EDGES)


def display_from_world(mount_height_m: float | None, mount_tilt_rad: float | None) -> Pose:
    """``T_display_world``: z up, x ahead of the first frame's camera, the floor at z = 0.

    Args:
        mount_height_m: of the left camera above the floor; where unknown it is put at z = 0.
        mount_tilt_rad: by which it looks down from the horizontal; level where unknown.
    """
    tilt = mount_tilt_rad or 0.0
    cos, sin = np.cos(tilt), np.sin(tilt)
    about_left = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    return Pose(about_left @ _LEVEL, np.array([0.0, 0.0, mount_height_m or 0.0]))


def box_edges(center: ArrayLike, size: ArrayLike, rotation: ArrayLike) -> Float64Array:
    """The 12 edges (12, 2, 3) of a box.

    Args:
        size: (3,) extent along the box's own axes. rotation: (3, 3) box axes in the world.
    """
    half = np.asarray(size, dtype=np.float64) / 2
    corners = (_CORNERS * half) @ np.asarray(rotation).T + np.asarray(center)
    return np.asarray(corners[_EDGES], dtype=np.float64)


def upright_rotation(yaw: float, up: Float64Array) -> Float64Array:
    """(3, 3) axes of a body that stands on the floor: columns ahead, left, up in the world.

    Args:
        yaw: heading in the world's x-z plane, 0 along z and positive to the right (``TrueBody``).
        up: (3,) unit vector in the world.
    """
    ahead = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([ahead, np.cross(up, ahead), up], axis=1)


def trail_segments(positions: Sequence[ArrayLike]) -> Float64Array:
    """(N - 1, 2, 3) lines through N positions."""
    points = [np.asarray(p, dtype=np.float64) for p in positions]
    return np.array([(a, b) for a, b in pairwise(points)]).reshape(-1, 2, 3)


def floor_lines(half_width_m: int, step_m: float = 1.0) -> Float64Array:
    """(N, 2, 3) lines of a square grid on z = 0 around the origin, along x and along y."""
    at = np.arange(-half_width_m, half_width_m + step_m / 2, step_m)
    far = np.full_like(at, half_width_m)
    zero = np.zeros_like(at)
    along_x = np.stack([np.stack([-far, at, zero], 1), np.stack([far, at, zero], 1)], axis=1)
    return np.concatenate([along_x, along_x[..., [1, 0, 2]]])


def padded(rows: NDArray[Any], count: int) -> NDArray[Any]:
    """Exactly ``count`` rows: the first ones, or the last one repeated, which is not seen."""
    if len(rows) >= count:
        return rows[:count]
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])


def thinned(count: int, most: int) -> slice:
    """Every k-th of ``count`` rows, so that at most ``most`` remain, evenly spread."""
    return slice(None, None, max(1, -(-count // most)))


def greyed(colors: Colors) -> Colors:
    """Faded to grey: what is shown is old."""
    level = 90 + colors.mean(axis=-1, keepdims=True) * 0.25
    return np.repeat(level, 3, axis=-1).astype(np.uint8)


class Follower:
    """Keeps the robot within sight: the scene moves along once it is further than ``radius_m``.

    Within the radius nothing moves, so that a robot in a room is seen to drive.
    """

    def __init__(self, radius_m: float = 4.0) -> None:
        self._radius = radius_m
        self._anchor = np.zeros(2)

    def reset(self) -> None:
        self._anchor = np.zeros(2)

    def offset(self, position_display: Float64Array) -> Float64Array:
        """(3,) by which the display is shifted; horizontal only."""
        away = position_display[:2] - self._anchor
        distance = float(np.linalg.norm(away))
        if distance > self._radius:
            self._anchor = self._anchor + away * (1 - self._radius / distance)
        return np.array([-self._anchor[0], -self._anchor[1], 0.0])
