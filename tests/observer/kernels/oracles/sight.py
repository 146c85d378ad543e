"""Oracle of ``observer.kernels.sight``: the same by numpy and the classes of poses and cameras."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose


def sighting(
    px: Float64Array,
    disparity: float,
    sigmas: Float64Array,
    T_world_camera: Pose,
    camera: StereoCamera,
) -> tuple[Float64Array, Float64Array]:
    """Place (3,) m, world, of a thing seen at a pixel (2,), and its covariance (3, 3).

    Args:
        sigmas: (3,) standard deviations across the line of sight, down and along it.
    """
    place = camera.triangulate(px, disparity)
    spread = T_world_camera.rotation @ sight_axes(place) * sigmas
    return T_world_camera.apply(place), spread @ spread.T


def sight_axes(place: Float64Array) -> Float64Array:
    """(3, 3) columns, unit length: across the line of sight to a place (3,), level, down, along."""
    ray = place / np.linalg.norm(place)
    across = np.array([ray[2], 0.0, -ray[0]]) / np.hypot(ray[0], ray[2])
    return np.stack([across, np.cross(ray, across), ray], axis=1)
