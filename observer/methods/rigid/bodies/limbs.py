"""Bodies whose limbs move by themselves: people. Their velocity is that of the trunk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.dense.segments import TRUNK_SHARE
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

# A body is rigid while this share of the points on it moves as it does; the share follows the
# newest frame so fast, of at least so many points.
_RIGID_SHARE = 0.55
_SHARE_GAIN = 0.2
_LEAST_POINTS = 4
# Points show a whole body, if they are so many, over these shares of its height and width.
_WHOLE_POINTS, _WHOLE_HEIGHT, _WHOLE_WIDTH = 8, 0.75, 0.6
# Robust mean of the points' velocities: weights fall from so many deviations on, to none.
_FULL_SIGMAS, _LEAVE_SIGMAS, _MEDIAN_SIGMAS = 2.0, 4.0, 1.5
_STEPS = 3
_CORRELATED = 0.3
# m/s, the trunk's sway about its mean; and the squared length from which on a mean is doubted.
_SWAY_MPS = 0.08
_FAR_CHI2 = 12.0
_LEAST_INFORMATION = 1e-9


def judge_rigidity(track: BodyTrack, moves_along: NDArray[np.bool_]) -> None:
    """Learn from which of the points on a body (N,) move along whether its limbs do so.

    Only what stands upright may have limbs. A body that has turned out to have some keeps them,
    and is from now on measured by its trunk, whose yaw nothing shows.
    """
    assert track.outline is not None
    if not (track.rigid and track.outline.upright):
        return
    if len(moves_along) >= _LEAST_POINTS:
        track.rigidity += _SHARE_GAIN * (float(moves_along.mean()) - track.rigidity)
    elif not points_show_whole(track, track.outline):
        track.rigidity *= 1 - _SHARE_GAIN
    if track.rigidity < _RIGID_SHARE:
        track.loosen()


def points_show_whole(track: BodyTrack, outline: Outline) -> bool:
    """Return whether a rigid body's points lie all over its outline."""
    if track.points < _WHOLE_POINTS or not track.rigid:
        return False
    u0, v0, u1, v1 = track.box_px
    a0, b0, a1, b1 = outline.box_px
    return v1 - v0 > _WHOLE_HEIGHT * (b1 - b0) and u1 - u0 > _WHOLE_WIDTH * (a1 - a0)


def measure_trunk(
    track: BodyTrack,
    on_body: NDArray[np.intp],
    points: TrackedPoints,
    sightings: WorldSightings,
    dt: float,
) -> None:
    """Update a body's velocity by how far the points on its trunk went since the last frame.

    Args:
        on_body: (K,) the points that are surely on it. dt: seconds.
    """
    assert track.outline is not None
    _, top, _, bottom = track.outline.box_px
    on_trunk = points.px[on_body, 1] < top + TRUNK_SHARE * (bottom - top)
    chosen = on_body[on_trunk & np.isfinite(points.moved[on_body, 0])]
    if len(chosen) < _LEAST_POINTS:
        return
    # Both sightings of a point are equally uncertain.
    information = sightings.information[chosen] * (dt * dt / 2)
    velocity, cov = _robust_mean(points.moved[chosen] / dt, information)
    gap = velocity - track.mean[VELOCITY]
    expected = track.filter.covariance[VELOCITY, VELOCITY] + cov
    squared = float(gap @ np.linalg.solve(expected, gap))
    # Far from the body's velocity it is rather that of a limb.
    doubt = max(1.0, squared / _FAR_CHI2) ** 2
    track.filter = track.filter.with_velocity(velocity, cov * doubt)


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
