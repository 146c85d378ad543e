"""Membership of points in bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.chi_square import quantile
from observer.geometry import Float64Array
from observer.kernels.inverses import inverse_3x3
from observer.kernels.membership import against_rest, place_on_body
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import ObstacleParameters
from observer.types import MotionState

# A point joins if its velocity fits the body's and that is this much likelier than rest (twice the
# logarithm of the likelihood ratio: e^4 = 55 times); it leaves if that is so much less likely.
_JOIN_CHI2 = quantile(0.99, df=3)
SURE_RATIO = 8.0
# Of a body whose earlier motion is of no account: no instants, and no motions at them.
_NEVER, _NO_MOTION = np.zeros(0), np.zeros((0, 4))


def joining(
    track: BodyTrack,
    free: NDArray[np.intp],
    motion: PooledMotion,
    parameters: ObstacleParameters,
) -> NDArray[np.bool_]:
    """(K,) which free points (K,) lie on the body and move with it rather than rest."""
    now = motion.position[free]
    # Rounding makes variances of next to nothing negative.
    sigma = np.sqrt(np.maximum(np.einsum("nii->n", motion.position_cov[free]), 0.0))
    room = track.room(parameters.margin)
    inside = track.contains(now, room + np.minimum(2 * sigma, room))
    inner = free[inside]
    apart, ratio, _ = _against_rest(track, inner, motion, recently=False)
    inside[inside] = (apart <= _JOIN_CHI2) & (ratio >= SURE_RATIO)
    return inside


def resting(track: BodyTrack, members: NDArray[np.intp], motion: PooledMotion) -> NDArray[np.bool_]:
    """(K,) which members (K,) of a moving body rest.

    A point that slid onto the edge of something in front of the body stays there. Such points need
    not be misfits: a body that is thought to turn about them explains them, and then its whole
    state is wrong. If a body does not travel, all its points rest, and none leaves.
    """
    if track.motion is not MotionState.MOVING:
        return np.zeros(len(members), np.bool_)
    # The points' own velocities are means over their windows, in the middle of which a body that
    # gains speed, brakes or turns to and fro moved differently. Any of its motions within a window
    # may explain a point: until the body has been fast for the whole window, its points cannot be
    # told from resting ones.
    _, now, then = _against_rest(track, members, motion, recently=True)
    likeliest = np.maximum(now, then)
    return np.asarray(motion.judged[members] & (likeliest <= -SURE_RATIO))


def _against_rest(
    track: BodyTrack, which: NDArray[np.intp], motion: PooledMotion, *, recently: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Compare "moves with the body" with "rests" for points (K,), see the kernel ``against_rest``.

    Args:
        recently: compare with the body's motion of the last seconds, too.
    """
    ago, moved = track.recent.instants() if recently else (_NEVER, _NO_MOTION)
    return against_rest(
        motion.own_velocity.take(which, axis=0),
        motion.own_information.take(which, axis=0),
        motion.shared_cov.take(which, axis=0),
        motion.window_s.take(which),
        motion.position.take(which, axis=0),
        track.mean,
        ago,
        moved,
    )


def placed(track: BodyTrack, sums: PositionVelocityFilter) -> tuple[Float64Array, Float64Array]:
    """Return positions (N, 3) m, world, of points that moved as the body does, and information.

    Their sightings are ``z = p + v s + a s^2 / 2`` with the velocity v and the acceleration a that
    the turning body has there. The turn may have differed over that time, and a body that gained
    speed or braked was slower or faster then, which makes the position less certain.
    """
    age, squared_age = sums.ages()
    gained = track.recent.acceleration(age)
    return place_on_body(
        sums.origin, sums.a0, sums.a1, sums.a2, sums.b0, track.mean, gained, squared_age
    )


def shape_position(points: TrackedPoints, which: NDArray[np.intp]) -> Float64Array:
    """(K, 3) metres: where points are on their obstacle, in its own frame."""
    cov = inverse_3x3(points.shape_information.take(which, axis=0))
    vector = points.shape_vector.take(which, axis=0)
    return np.asarray(np.einsum("nij,nj->ni", cov, vector), np.float64)
