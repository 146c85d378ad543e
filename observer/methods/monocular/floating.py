"""Obstacles moving along the line of sight: their parallax depth contradicts their ground contact.

A point that approaches the camera stays on its line of sight and looks like a nearer static point.
A group of such points seems to float: at its lower edge the ground is much farther away. Objects
that really hang in the air look the same, so the margin is wide, and the obstacle must also move
over the ground.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.monocular.ground import GroundView
from observer.methods.monocular.ground_contact import (
    box_around,
    ground_place,
    lower_edge,
    lowest_row,
)
from observer.methods.monocular.rays import RayPoints
from observer.parameters import MonocularParameters
from observer.types import Image
from observer.vision.lifecycle import NO_OBSTACLE

# Tracked for this long, seconds, and this many times nearer than the ground on the same line of
# sight.
_LEAST_AGE_S, _OFF_FLOOR = 0.5, 1.3
# Points of one object agree in depth to within this share.
_ALIKE = 0.25
# A group must be this many times nearer than its foot, by this many standard deviations.
_NEARER, _SIGMAS = 2.0, 3.0
# Factor on the depth sigma: depths come from the same poses, so their errors are correlated.
_SHARED = 3.0


def off_ground(points: RayPoints, view: GroundView) -> tuple[NDArray[np.bool_], Float64Array]:
    """(N,) which points seem to be clear of the ground, and (N,) their inverse distance now."""
    here = view.T_world_camera.translation
    gap = points.place() - here
    reach = np.linalg.norm(gap, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = 1 / reach
        bound = view.ground.inverse_distance(here, gap / reach[:, None])
    free = ~points.moving & (points.obstacle == NO_OBSTACLE) & (points.age_s >= _LEAST_AGE_S)
    sure = points.inverse > 3 * _SHARED * np.sqrt(points.variance)
    with np.errstate(invalid="ignore"):
        clear = inverse > _OFF_FLOOR * np.maximum(bound, 0.0)
    return np.asarray(free & sure & clear), np.nan_to_num(inverse)


def alike_in_depth(pairs: NDArray[np.intp], inverse: Float64Array) -> NDArray[np.intp]:
    """Return those of the pairs (P, 2) whose inverse distances (N,) are alike."""
    a, b = inverse[pairs[:, 0]], inverse[pairs[:, 1]]
    return np.asarray(pairs[np.abs(a - b) <= _ALIKE * np.maximum(a, b)])


def floating(
    points: RayPoints,
    groups: NDArray[np.int64],
    inverse: Float64Array,
    image: Image,
    view: GroundView,
    p: MonocularParameters,
) -> tuple[NDArray[np.int64], Float64Array]:
    """Return the groups (N,) that float, -1 elsewhere, and (N,) by how many standard deviations."""
    out, significance = np.full(len(points), -1, np.int64), np.zeros(len(points))
    tilt_sigma = float(np.radians(p.tilt_sigma_deg))
    found = 0
    for number in range(int(groups.max(initial=-1)) + 1):
        members = groups == number
        px = points.px[members]
        box = box_around(px)
        middle = float(np.mean(box[::2], dtype=np.float32))
        foot = lower_edge(image, box, lowest_row(px))
        if foot is None:
            continue
        sigma = (p.foot_sigma_px, p.foot_sigma_px)
        placed = ground_place((middle, foot), sigma, view)
        if placed is None:
            continue
        reach = float(np.linalg.norm(placed[0] - view.here))
        if reach > p.farthest_m:
            continue
        share = np.hypot(
            np.sqrt(np.trace(placed[1])) / reach, tilt_sigma * reach / view.ground.depth
        )
        near = float(np.median(inverse[members]))
        doubt = _SHARED * float(np.median(np.sqrt(points.variance[members])))
        excess = (near - _NEARER / reach) / float(np.hypot(doubt, _NEARER / reach * share))
        if excess > _SIGMAS:
            out[members], significance[members] = found, excess
            found += 1
    return out, significance
