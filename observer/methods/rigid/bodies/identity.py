"""Identity of bodies: which one a group of points belongs to, and which tracks are one body."""

from __future__ import annotations

import numpy as np

from observer.chi_square import quantile
from observer.geometry import Float64Array, largest_sigma, mahalanobis
from observer.kernels.membership import moves_along
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION
from observer.methods.rigid.bodies.groups import Group
from observer.methods.rigid.bodies.membership import SURE_RATIO
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.dense.segments import TRUNK_SHARE, depth_gap_m
from observer.parameters import ObstacleParameters
from observer.types import TrackState

# Two velocities in space that differ by no more than this belong to one body.
_SAME_CHI2 = quantile(0.999, df=3)
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
# Standard deviations of a velocity that is no noise; metres from a box beyond which something is
# beside it.
_PASSING_SIGMAS, _BESIDE_M = 5.0, 0.1
# Least distance between the middles of two people, metres; and most by which the velocities of one
# person's parts differ, m/s.
_PARTS_M, _PARTS_MPS = 0.3, 0.4
# Metres by which one person is farther away than another before whom they walk: no part is.
_BEHIND_M = 0.4
# Seconds for which two bodies must both be known before they stay two permanently.
_KNOWN_S = 1.0


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
    if _passes(older, younger):
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


def _passes(older: BodyTrack, younger: BodyTrack) -> bool:
    """Return whether points move beside something that is seen at rest, and never moved for sure.

    Its velocity may still be so uncertain that it could be theirs.
    """
    outline = older.seen_outline
    rests = older.state is TrackState.TENTATIVE and outline is not None and outline.is_static
    if not rests or younger.outline is not None:
        return False
    moves = mahalanobis(*younger.centre_velocity()) > _PASSING_SIGMAS
    return moves and not older.contains(younger.centre[None], _BESIDE_M)[0]


def _are_parts(a: BodyTrack, b: BodyTrack) -> bool:
    """Return whether two bodies are parts of one: trunk and legs, or a robot's base and its mast.

    They are nearer to each other than two people could be, and move alike. Somebody who was hidden
    for a while may be seen again in two parts.
    """
    if a.seen_outline is None or b.seen_outline is None or a.rigid != b.rigid:
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
    least = (a_box.size[0] + b_box.size[0]) / 4 + _LIMB_APART_M
    if _one_behind_other(a.seen_outline, b.seen_outline):
        least = _PARTS_M
    return bool(np.hypot(across, along) > least)


def _one_behind_other(a: Outline | None, b: Outline | None) -> bool:
    """Return whether two outlines are as high as people, and one is seen well behind the other."""
    if a is None or b is None or not all(each.is_high and each.upright for each in (a, b)):
        return False
    return depth_gap_m(a.segment, b.segment, a.grid) > _BEHIND_M


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
    return bool(apart <= _SAME_CHI2 and ratio > -SURE_RATIO)
