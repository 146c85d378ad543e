"""The velocity of a body with limbs: that of its trunk, by its picture and by its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.outline import sight_axes
from observer.methods.rigid.bodies.trunk_view import TrunkView
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import TRUNK_SHARE
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

# m/s, one standard deviation: the trunk's sway about its mean, across and upwards; and what a
# measurement does not tell.
_SWAY_MPS, _BOB_MPS, _UNKNOWN_MPS = 0.06, 0.2, 3.0
# A trunk is looked for as many deviations of the velocity away, and at most so many cells; and
# while it is no more than this much nearer or farther than in the frame before.
_REACH_SIGMAS, _MOST_REACH = 2.0, 10
_MOST_SCALE = 2.0
# Points on the trunk that tell its velocity, and the squared length from which on that is doubted.
_LEAST_POINTS = 4
_FAR_CHI2 = 12.0
# Robust mean of the points' velocities: weights fall from so many deviations on, to none.
_FULL_SIGMAS, _LEAVE_SIGMAS, _MEDIAN_SIGMAS = 2.0, 4.0, 1.5
_STEPS = 3
_CORRELATED = 0.3
_LEAST_INFORMATION = 1e-9


def measure_trunk(
    track: BodyTrack,
    on_body: NDArray[np.intp],
    points: TrackedPoints,
    sightings: WorldSightings,
    scene: DenseScene,
    dt: float,
) -> None:
    """Update a body's velocity by how far its trunk went since the last frame.

    Across the line of sight by its picture, whose place is precise, and along it by the points.

    Args:
        on_body: (K,) the points that are surely on it. dt: seconds.
    """
    assert track.outline is not None
    before = track.outline.trunk
    track.outline.trunk = TrunkView.of(track.outline.segment, scene, track.age_s)
    if before is not None:
        _measure_across(track, before, scene, track.age_s - before.age_s)
    _, top, _, bottom = track.outline.box_px
    on_trunk = points.px[on_body, 1] < top + TRUNK_SHARE * (bottom - top)
    chosen = on_body[on_trunk & np.isfinite(points.moved[on_body, 0])]
    if len(chosen) >= _LEAST_POINTS:
        # Both sightings of a point are equally uncertain.
        information = sightings.information[chosen] * (dt * dt / 2)
        _measure_along(track, points.moved[chosen] / dt, information, scene)


def _measure_across(track: BodyTrack, before: TrunkView, scene: DenseScene, dt: float) -> None:
    """Measure the velocity across the line of sight, by a view of ``dt`` seconds before."""
    grid, camera, velocity = scene.grid, scene.grid.camera, track.mean[VELOCITY]
    px = grid.to_px(before.middle[None])
    begin = camera.triangulate(px, np.array([before.disparity]))
    begin = before.T_world_camera.apply(begin)
    places = scene.T_camera_world.apply(begin + np.outer([dt, 0.0], velocity))
    px, disparities = camera.project(places)
    disparity = disparities[:1]
    scale = float(disparity[0]) / before.disparity
    if not (np.isfinite(px).all() and 1 / _MOST_SCALE < scale < _MOST_SCALE):
        return
    per_cell = 1 / (grid.per_metre(float(disparity[0])) * dt)
    cov = track.filter.covariance[VELOCITY, VELOCITY]
    sigma = float(np.sqrt(np.trace(cov) / 3))
    reach = min(_MOST_REACH, int(_REACH_SIGMAS * sigma / per_cell))
    expected, standing = grid.to_cells(px)
    found = before.found_in(scene.left, expected, standing, scale, reach)
    if found is None:
        return
    cells, noise = found
    end = camera.triangulate(grid.to_px(cells[None]), disparity)
    sigmas = np.hypot(np.sqrt(np.diag(noise)) * per_cell, [_SWAY_MPS, _BOB_MPS])
    axes = scene.T_world_camera.rotation @ sight_axes(end[0])
    spread = axes * [*sigmas, _UNKNOWN_MPS]
    moved = (scene.T_world_camera.apply(end) - begin)[0]
    _update(track, moved / dt, spread @ spread.T, 1)


def _measure_along(
    track: BodyTrack, velocity: Float64Array, information: Float64Array, scene: DenseScene
) -> None:
    """Measure the velocity along the line of sight, by those (N, 3) m/s of points."""
    assert track.outline is not None
    mean, cov = _robust_mean(velocity, information)
    ahead = track.outline.middle - scene.T_world_camera.translation
    ahead /= np.linalg.norm(ahead)
    across = np.eye(3) - np.outer(ahead, ahead)
    _update(track, mean, cov + across * _UNKNOWN_MPS**2, 2)


def _update(track: BodyTrack, velocity: Float64Array, noise: Float64Array, power: int) -> None:
    """Update by a velocity (3,) m/s with covariance (3, 3); one that is far off counts less.

    Args:
        power: to which the doubt is raised: far from the body's velocity it is that of a limb.
    """
    gap = velocity - track.mean[VELOCITY]
    expected = track.filter.covariance[VELOCITY, VELOCITY] + noise
    squared = float(gap @ np.linalg.solve(expected, gap))
    doubt = max(1.0, squared / _FAR_CHI2) ** power
    track.filter = track.filter.with_velocity(velocity, noise * doubt)


def _robust_mean(
    velocity: Float64Array, information: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """(3,) mean of velocities (N, 3) m/s and its covariance (3, 3), by iterated reweighting."""
    mean = np.median(velocity, axis=0)
    for _ in range(_STEPS):
        apart = velocity - mean
        length = np.sqrt(np.einsum("ni,nij,nj->n", apart, information, apart))
        scale = max(1.0, float(np.median(length)) / _MEDIAN_SIGMAS)
        weight = np.minimum(1.0, _FULL_SIGMAS * scale / np.maximum(length, 1e-9))
        weight[length > _LEAVE_SIGMAS * scale] = 0.0
        total = np.einsum("n,nij->ij", weight, information) + np.eye(3) * _LEAST_INFORMATION
        mean = np.linalg.solve(total, np.einsum("n,nij,nj->i", weight, information, velocity))
    used = max(1.0, float(weight.sum()))
    cov = np.linalg.inv(total) * scale**2 * (1 + _CORRELATED * used)
    scatter = np.median(np.abs(velocity - mean), axis=0) * _MEDIAN_SIGMAS
    return mean, cov + np.diag(_SWAY_MPS**2 + 2 * scatter**2 / used)
