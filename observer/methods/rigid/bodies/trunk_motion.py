"""The velocity of a body with limbs: that of its trunk, by its image and by its points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.body_filter import squared_gap
from observer.kernels.sight import place_of, sighting, view_of
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.trunk_view import TrunkView
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import TRUNK_SHARE
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

_EYE = np.eye(3)
# m/s, one standard deviation: the trunk's sway about its mean, across and upwards; and a velocity
# that is not measured.
_SWAY_MPS, _BOB_MPS, _UNKNOWN_MPS = 0.035, 0.2, 30.0
# m/s, one standard deviation of a body's vertical speed.
_LEVEL_MPS = 0.05
# A trunk is looked for up to so many standard deviations of the velocity away, and at most so many
# cells; and only while it is at most this many times nearer or farther than in the frame before.
_REACH_SIGMAS, _MOST_REACH = 2.0, 10
_MOST_SCALE = 2.0
# Squared Mahalanobis length above which a velocity counts less.
_FAR_CHI2 = 12.0


def measure_trunk(
    track: BodyTrack,
    on_body: NDArray[np.intp],
    points: TrackedPoints,
    sightings: WorldSightings,
    scene: DenseScene,
    dt: float,
) -> None:
    """Update a body's velocity by how far its trunk went since the last frame.

    Across the line of sight by its image, which tells that precisely, and along it by the points.

    Args:
        on_body: (K,) the points that are surely on it. dt: seconds.
    """
    assert track.outline is not None
    _keep_level(track, scene)
    if track.outline.only_legs:
        track.outline.lose_trunk()
        return
    before = track.outline.trunk
    track.outline.trunk = TrunkView.of(track.outline.segment, scene, track.age_s)
    if before is not None:
        _measure_across(track, before, scene, track.age_s - before.age_s)
    _, top, _, bottom = track.outline.box_px
    on_trunk = points.px[on_body, 1] < top + TRUNK_SHARE * (bottom - top)
    chosen = on_body[on_trunk & np.isfinite(sightings.position[on_body, 0])]
    depths = track.outline.depths
    track.filter = depths.measure(track.filter, chosen, points, sightings, scene, dt)


def _keep_level(track: BodyTrack, scene: DenseScene) -> None:
    """Let a body neither rise nor sink: it walks on the ground."""
    if scene.ground is None:
        return
    down = scene.ground.down[:, None] * scene.ground.down
    velocity = track.mean[VELOCITY]
    noise = down * _LEVEL_MPS**2 + (_EYE - down) * _UNKNOWN_MPS**2
    track.filter = track.filter.with_velocity(velocity - down @ velocity, noise)


def _measure_across(track: BodyTrack, before: TrunkView, scene: DenseScene, dt: float) -> None:
    """Measure the velocity across the line of sight by a view from ``dt`` seconds before."""
    grid, camera, velocity = scene.grid, scene.grid.camera.numbers, track.mean[VELOCITY]
    then, pose, back = before.T_world_camera, scene.T_world_camera, scene.T_camera_world
    u, v = grid.to_px(before.middle).tolist()
    begin = place_of(u, v, before.disparity, then.rotation, then.translation, camera)
    goes = view_of(begin + dt * velocity, back.rotation, back.translation, camera)
    stays = view_of(begin, back.rotation, back.translation, camera)
    disparity = goes[2]
    scale = disparity / before.disparity
    if not (math.isfinite(stays[2]) and 1 / _MOST_SCALE < scale < _MOST_SCALE):
        return
    per_cell = 1 / (grid.per_metre(disparity) * dt)
    variances = track.filter.covariance.diagonal()[VELOCITY]
    sigma = math.sqrt(float(variances.sum()) / 3)
    reach = min(_MOST_REACH, int(_REACH_SIGMAS * sigma / per_cell))
    expected, standing = grid.to_cells(np.array([goes[:2], stays[:2]]))
    found = before.found_in(scene.left, expected, standing, scale, reach)
    if found is None:
        return
    cells, noise = found
    u, v = grid.to_px(cells).tolist()
    across = math.hypot(math.sqrt(noise[0, 0]) * per_cell, _SWAY_MPS)
    down = math.hypot(math.sqrt(noise[1, 1]) * per_cell, _BOB_MPS)
    end, spread = sighting(
        u, v, disparity, across, down, _UNKNOWN_MPS, pose.rotation, pose.translation, camera
    )
    _update(track, (end - begin) / dt, spread)


def _update(track: BodyTrack, velocity: Float64Array, noise: Float64Array) -> None:
    """Update by a velocity (3,) m/s with covariance (3, 3); one that is far off counts less."""
    gap = velocity - track.mean[VELOCITY]
    squared = squared_gap(gap, track.filter.covariance, VELOCITY.start, noise)
    track.filter = track.filter.with_velocity(velocity, noise * max(1.0, squared / _FAR_CHI2))
