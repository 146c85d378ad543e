"""Begins bodies where groups of points move, and restarts those that are found again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, largest_sigma
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY, BodyFilter
from observer.methods.rigid.bodies.groups import Group, group_of, mostly_lie
from observer.methods.rigid.bodies.identity import body_of, goes_with
from observer.methods.rigid.bodies.limbs import may_be_rigid, moves_as_one
from observer.methods.rigid.bodies.shape import BodyShape
from observer.methods.rigid.motion_test import group_dynamic
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import ObstacleParameters
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

# rad/s, one standard deviation: yaw rate of a body that was just found.
YAW_RATE_SIGMA = 0.6
# A group slower than this share of the stopped speed creeps: it is an edge along which points
# slide, and no obstacle.
_CREEPING = 0.5
# m^2: a group's middle is the body's origin by definition.
_ORIGIN_VARIANCE = 1e-6


def spawned(
    tracks: list[BodyTrack],
    numbers: TrackIds,
    points: TrackedPoints,
    motion: PooledMotion,
    lying: NDArray[np.bool_],
    radius_m: Callable[[Float64Array], float],
    parameters: ObstacleParameters,
) -> NDArray[np.int64]:
    """Turn groups of dynamic points into bodies, or return them to those lost from sight.

    Shadows and reflections move, too: a group that is mostly on the ground is no obstacle.

    Args:
        tracks: of all bodies; new ones are added. numbers: gives them their numbers.
        lying: (N,) which points lie on the ground.
        radius_m: metres within which points count as neighbours at a place (3,) m, world.

    Returns:
        (N,) the body that each point belongs to.
    """
    # Points on a body's outline are its own, though none is known to move with it yet.
    stiff = [t for t in tracks if may_be_rigid(t)]
    free = (points.obstacle == NO_OBSTACLE) & (points.tenure >= 0)
    free &= (points.within == NO_OBSTACLE) | np.isin(points.within, [t.id for t in stiff])
    groups = group_dynamic(motion, free, parameters.min_points)
    obstacle = points.obstacle.copy()
    for number in range(int(groups.max(initial=-1)) + 1):
        candidates = np.flatnonzero(groups == number)
        reach = radius_m(np.median(motion.position[candidates], axis=0))
        group = group_of(candidates, motion, parameters, reach)
        if group is None or mostly_lie(lying[group.members]):
            continue
        if np.linalg.norm(group.velocity) < _CREEPING * parameters.stopped_below_mps:
            continue
        members = group.members
        track = _outlined(points.within[members], stiff)
        if track is not None:
            # Only the largest group on a body gives its motion.
            if track.rigid or not _stiffens(track, group, parameters):
                continue
            track.stiffen(_start_filter(group))
        else:
            track = body_of(group, tracks)
        if track is None:
            track = BodyTrack(
                id=numbers.provisional(), filter=_start_filter(group), shape=BodyShape()
            )
            tracks.append(track)
        elif track.forgotten or (track.rigid and track.missed_s > 0):
            # A body lost only for a moment restarts if it is rigid: with limbs, the points
            # are rather on an arm. Where its points were is of no use any more.
            obstacle[obstacle == track.id] = NO_OBSTACLE
            track.restart(_start_filter(group))
        elif track.box is not None:
            room = track.room(parameters.margin)
            members = members[track.contains(group.places, 2 * room)]
        obstacle[members] = track.id
    return obstacle


def _outlined(within: NDArray[np.int64], tracks: list[BodyTrack]) -> BodyTrack | None:
    """Return the body on whose outline most points of a group (K,) lie; None if none."""
    for track in tracks:
        if np.count_nonzero(within == track.id) > len(within) / 2:
            return track
    return None


def _stiffens(track: BodyTrack, group: Group, parameters: ObstacleParameters) -> bool:
    """Return whether a group on the outline of a body shows that the body is rigid."""
    if not track.contains(group.centre[None], track.room(parameters.margin))[0]:
        # At another depth than the body on whose outline they are seen.
        return False
    # Points that slide off its edge onto what is behind it seem to move fast.
    rigid = goes_with(track, group) and moves_as_one(track, group.velocity, len(group.members))
    return rigid and not _is_known_better(track, group)


def _is_known_better(track: BodyTrack, group: Group) -> bool:
    """Return whether a reported body's velocity is better known than that of points on it."""
    if track.state is TrackState.TENTATIVE:
        return False
    own = largest_sigma(track.filter.covariance[VELOCITY, VELOCITY])
    return own < largest_sigma(group.velocity_cov)


def _start_filter(group: Group) -> BodyFilter:
    """Return the motion of a body known only by a group; its origin is the group's middle."""
    here = np.eye(3) * _ORIGIN_VARIANCE
    return BodyFilter.begin(group.centre, group.velocity, here, group.velocity_cov, YAW_RATE_SIGMA)
