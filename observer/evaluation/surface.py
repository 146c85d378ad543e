"""Visible surface of a true body, as seen from the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.truth.contract import TrueBody

# A side with less than this share of the body's visible area counts as unseen.
_SEEN_SHARE = 0.15


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """Faces of a body's box that the camera sees.

    Attributes:
        centre: (3,) metres, world: mean of the faces towards the camera, weighted by apparent
            size.
        sides: numbers of the upright faces that are properly seen (0 front, 1 back, 2 right,
            3 left).
    """

    centre: Float64Array
    sides: frozenset[int]


def visible_surface(body: TrueBody, camera_position: Float64Array) -> VisibleSurface:
    """Return the faces of the body's box, upright in the world, that a camera sees.

    Occlusion by other bodies is ignored. From inside the box no side is seen, and the centre is
    the body's.

    Args:
        camera_position: (3,) metres, world.
    """
    length, width, height = body.size
    forward = np.array([np.sin(body.yaw), 0.0, np.cos(body.yaw)])
    right = np.array([np.cos(body.yaw), 0.0, -np.sin(body.yaw)])
    down = np.array([0.0, 1.0, 0.0])
    axes = np.stack([forward, -forward, right, -right, down, -down])
    reach = np.array([length, length, width, width, height, height]) / 2
    area = np.array([width * height] * 2 + [length * height] * 2 + [length * width] * 2)
    faces = body.position + axes * reach[:, None]
    towards = camera_position - faces
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    seen = np.maximum(np.einsum("ij,ij->i", axes, towards) / distance, 0.0) * area / distance**2
    if seen.sum() <= 0:
        return VisibleSurface(body.position, frozenset())
    share = seen / seen.sum()
    return VisibleSurface(
        centre=np.asarray(share @ faces, dtype=np.float64),
        sides=frozenset(int(i) for i in np.flatnonzero(share[:4] >= _SEEN_SHARE)),
    )
