"""Membership of points in bodies, and identity of bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.chi_square import quantile
from observer.geometry import Float64Array, largest_sigma
from observer.kernels.inverses import inverse_3x3
from observer.kernels.membership import against_rest, moves_along, place_on_body
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.dense.segments import TRUNK_SHARE
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import ObstacleParameters
from observer.robust import MAD_TO_SIGMA
from observer.types import MotionState, TrackState

# A point joins if its velocity fits the body's and that is this much likelier than rest (twice the
# logarithm of the likelihood ratio: e^4 = 55 times); it leaves if that is so much less likely.
_JOIN_CHI2 = quantile(0.99, df=3)
_SURE_RATIO = 8.0
# Two velocities in space that differ by no more than this belong to one body.
_SAME_CHI2 = quantile(0.999, df=3)
# Standard deviations: a member further than this from the middle of a group is dropped.
_STRAY = 4.0
# Share of the speed by which a body's velocity may differ from that of points seen again, as it may
# have turned or braked while hidden; and by which the velocities of its parts may differ.
_CHANGED_WHILE_HIDDEN = 0.3
_PARTS_DIFFER = 0.12
# Metres, the extent of a body whose box is not known yet, and standard deviations of its position
# within which points may belong to it.
_FIRST_EXTENT_M = 0.3
_FOUND_SIGMAS = 2.5
# Metres beyond half its width that a foot may be beside its body.
_STRIDE_M = 0.35
# Metres beyond half their mean width that a limb seen by itself may be away from its body.
_LIMB_APART_M = 0.3
# Least distance between the middles of two people, metres; and most by which the velocities of one
# person's parts differ, m/s.
_PARTS_M, _PARTS_MPS = 0.3, 0.4
# (m/s)^2: the velocity of a group is never known better than to a millimetre per second.
_LEAST_VELOCITY_VARIANCE = 1e-6
# Seconds for which two bodies must both be known before they stay two permanently.
_KNOWN_S = 1.0
# Share of a body's points that may lie on the ground, as shadows do.
_LYING_SHARE = 0.5
# No instants before now.
_NEVER, _NO_MOTION = np.zeros(0), np.zeros((0, 4))


@dataclass(frozen=True, eq=False)
class Group:
    """Points that move alike.

    Attributes:
        members: (K,) their indices. places: (K, 3) metres, world. centre: (3,), their median.
        velocity: (3,) m/s, world, with covariance (3, 3).
    """

    members: NDArray[np.intp]
    places: Float64Array
    centre: Float64Array
    velocity: Float64Array
    velocity_cov: Float64Array


def group_of(
    candidates: NDArray[np.intp],
    motion: PooledMotion,
    parameters: ObstacleParameters,
    reach: float = 0.0,
) -> Group | None:
    """Group the candidates (K,), without strays; None if they are too few.

    Args:
        reach: metres within which points count as neighbours there.
    """
    members = candidates[_together(motion.position[candidates], reach)]
    if len(members) < parameters.min_points:
        return None
    information = motion.own_information[members]
    L = information.sum(axis=0)
    velocity = np.linalg.solve(L, np.einsum("nij,nj->i", information, motion.own_velocity[members]))
    cov = np.linalg.inv(L) * (1 + parameters.noise_correlation * len(members))
    places = motion.position[members]
    return Group(
        members=members,
        places=places,
        centre=np.median(places, axis=0),
        velocity=velocity,
        velocity_cov=cov + np.eye(3) * _LEAST_VELOCITY_VARIANCE,
    )


def mostly_lie(lying: NDArray[np.bool_]) -> bool:
    """Return whether so many of some points (N,) lie on the ground that they are no body."""
    return float(lying.mean()) > _LYING_SHARE


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
    inside[inside] = (apart <= _JOIN_CHI2) & (ratio >= _SURE_RATIO)
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
    return np.asarray(motion.judged[members] & (likeliest <= -_SURE_RATIO))


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


def body_of(group: Group, tracks: list[BodyTrack]) -> BodyTrack | None:
    """Return the track that a group belongs to, the nearest of several; None if there is none."""
    best, best_distance = None, np.inf
    # A body with an outline that was lost for long comes back whole, not as a few points.
    for track in [t for t in tracks if not (t.forgotten and t.outline)]:
        cov = track.filter.covariance[POSITION, POSITION]
        size = _FIRST_EXTENT_M
        if track.box is not None:
            size = float(np.linalg.norm(track.box.size[[0, 2]]))
        slack = 0.5 * size + _FOUND_SIGMAS * largest_sigma(cov)
        distance = float(np.linalg.norm(group.centre - track.centre))
        if distance <= min(slack, best_distance) and goes_with(track, group, _CHANGED_WHILE_HIDDEN):
            best, best_distance = track, distance
    return best


def goes_with(track: BodyTrack, group: Group, changed: float = _PARTS_DIFFER) -> bool:
    """Return whether a group of points on a body moves as the body is known to.

    Args:
        changed: share of the speed by which the two may differ beyond their uncertainty.
    """
    velocity, own = track.centre_velocity()
    return _moves_with(group.velocity, group.velocity_cov, velocity, own, changed)


def are_one(
    older: BodyTrack, younger: BodyTrack, reach: float, parameters: ObstacleParameters
) -> bool:
    """Return whether two tracks are one body: in one place, and moving as one or as its legs do.

    Args:
        reach: metres within which points count as neighbours there.
    """
    if older.box is None or younger.box is None:
        return False
    if _is_leg(older, older.box, younger, younger.box):
        return True
    if _are_parts(older, younger):
        return True
    if _stand_apart(older, older.box, younger, younger.box):
        return False
    room = older.room(parameters.margin) + younger.room(parameters.margin) + reach
    if not older.contains(younger.centre[None], room + younger.box.size[0] / 2)[0]:
        return False
    _, older_cov = older.centre_velocity()
    velocity, cov = younger.centre_velocity()
    expected = older.velocity_at(younger.centre)
    return _moves_with(velocity, cov, expected, older_cov, _PARTS_DIFFER)


def _are_parts(a: BodyTrack, b: BodyTrack) -> bool:
    """Return whether two bodies with limbs are parts of one person, such as trunk and legs.

    They are nearer to each other than two people could be, and move alike. Somebody who was hidden
    for a while may be seen again in two parts.
    """
    if a.seen_outline is None or b.seen_outline is None or a.rigid or b.rigid:
        return False
    across, _, along = (a.centre - b.centre).tolist()
    if np.hypot(across, along) > _PARTS_M:
        return False
    _, expected_cov = a.centre_velocity()
    velocity, cov = b.centre_velocity()
    expected = a.velocity_at(b.centre)
    if np.linalg.norm(velocity - expected) > _PARTS_MPS:
        return False
    return _moves_with(velocity, cov, expected, expected_cov, _CHANGED_WHILE_HIDDEN)


def _stand_apart(a: BodyTrack, a_box: Box, b: BodyTrack, b_box: Box) -> bool:
    """Return whether two bodies are separate things, too far from each other to be one.

    They must be seen as two now, or have both been reported: one that is out of sight by now may
    not take the number of another. Two that were reported and known for a while stay two, however
    near to each other: a cart and the person who pushes it.
    """
    if a.outline is None or b.outline is None:
        return False
    reported = TrackState.TENTATIVE not in (a.state, b.state)
    if reported and min(a.age_s, b.age_s) > _KNOWN_S:
        return True
    if not (reported or (a.outline.seen and b.outline.seen)):
        return False
    across, _, along = (a.centre - b.centre).tolist()
    return bool(np.hypot(across, along) > (a_box.size[0] + b_box.size[0]) / 4 + _LIMB_APART_M)


def _is_leg(body: BodyTrack, whole: Box, part: BodyTrack, box: Box) -> bool:
    """Return whether a track is a leg, something that moves below the trunk of a body with limbs.

    A confirmed track is not: a robot that passes at somebody's feet stays a track of its own.
    """
    if body.rigid or part.state is not TrackState.TENTATIVE:
        return False
    across, down, along = (part.centre - body.centre).tolist()
    beside = np.hypot(across, along) < whole.size[0] / 2 + _STRIDE_M
    below = down - box.size[1] / 2 > (TRUNK_SHARE - 0.5) * whole.size[1]
    return bool(beside and below)


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


def _moves_with(
    velocity: Float64Array,
    cov: Float64Array,
    expected: Float64Array,
    expected_cov: Float64Array,
    share: float,
) -> bool:
    """Return whether a velocity fits a body's expected one, and is not much likelier at rest.

    The two may truly differ by a share of the speed. The less is known of the body, the more
    velocities fit it; but what rests must not, for there is plenty of that everywhere.
    """
    real = share * max(float(np.linalg.norm(velocity)), float(np.linalg.norm(expected)))
    spread = cov + expected_cov + np.eye(3) * real**2
    apart, ratio = moves_along(velocity, velocity - expected, spread, cov)
    return bool(apart <= _SAME_CHI2 and ratio > -_SURE_RATIO)


def _together(position: Float64Array, reach: float) -> NDArray[np.bool_]:
    """(N,) which of a group's places (N, 3) are not far from most of the others.

    The spread of a few points says little; nearer than ``reach`` metres none is a stray.
    """
    apart = np.abs(position - np.median(position, axis=0))
    spread = MAD_TO_SIGMA * np.median(apart, axis=0)
    allowed = np.maximum(_STRAY * spread, reach)
    return np.asarray((apart <= allowed).all(axis=1), dtype=np.bool_)
