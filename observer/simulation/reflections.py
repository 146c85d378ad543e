"""Reflections in a glossy floor: the world seen by a camera mirrored below the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.simulation.batches import View, Window
from observer.simulation.polygons import Float32Array

# Reflectance of a polished floor at normal incidence, refractive index about 1.5.
_R0 = 0.04
_UPSIDE_DOWN = np.diag([1.0, -1.0, 1.0])
_MIRROR = np.diag([1.0, 1.0, -1.0])


def mirrored(view: View, T_room_camera: Pose, rows: tuple[int, int]) -> tuple[View, Pose]:
    """Return view and pose of the camera's mirror image below the floor.

    A mirrored camera would be left-handed; flipped upside down it is an ordinary one, whose row
    height - 1 - v is row v of the camera's image.

    Args:
        rows: of the camera's image that are needed.
    """
    first, last = rows
    upside_down = replace(
        view, cy=view.height - 1 - view.cy, rows=(view.height - last, view.height - first)
    )
    R = _MIRROR @ T_room_camera.rotation @ _UPSIDE_DOWN
    return upside_down, Pose(R, _MIRROR @ T_room_camera.translation)


def reflectance(
    view: View, window: Window, R_room_camera: Float64Array, gloss: float
) -> Float32Array:
    """Return (h, w) share of the light that a floor reflects towards each pixel of a window.

    Schlick, "An inexpensive BRDF model for physically-based rendering", 1994; ``gloss`` scales it.
    """
    u0, v0, u1, v1 = window
    x = (np.arange(u0, u1, dtype=np.float32) - np.float32(view.cx)) / np.float32(view.fx)
    y = (np.arange(v0, v1, dtype=np.float32)[:, None] - np.float32(view.cy)) / np.float32(view.fy)
    a, b, c = (np.float32(value) for value in R_room_camera[2])
    cosine = np.clip(-(a * x + (b * y + c)) / np.sqrt(x * x + (y * y + 1)), 0, 1)
    share = gloss * (_R0 + (1 - _R0) * (1 - cosine) ** 5)
    return np.asarray(share, np.float32)
