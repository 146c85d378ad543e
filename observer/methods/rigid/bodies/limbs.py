"""Tells people, whose limbs move on their own, from rigid bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.scatter import Scatter, scatter_of
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

# A body is rigid while this share of the points on it moves as it does; gain with which the share
# follows a new frame of at least so many points. Half of a person who begins to walk is still:
# taken for rigid, they would seem to go at the speed of the half that moves.
_RIGID_SHARE = 0.8
_SHARE_GAIN = 0.2
_LEAST_POINTS = 4
# So many points that moved as one for so many seconds are on no arm or leg, but for instance on a
# robot with a mast on which nothing can be tracked.
_MANY_POINTS, _STEADY_S = 12, 0.5
# m/s, one standard deviation of the points' own velocities, above which many are on several things.
_SCATTERED_MPS = 0.6
# So many points spread over these shares of its height and width show a whole body.
_WHOLE_POINTS, _WHOLE_HEIGHT, _WHOLE_WIDTH = 8, 0.75, 0.6


def judge_rigidity(track: BodyTrack, moves_along: NDArray[np.bool_]) -> None:
    """Judge by which of the points on a body (N,) move along with it whether it has limbs.

    Only an upright body may have some. Once that is found it is not judged again here, and its
    trunk measures it, whose yaw nothing shows.
    """
    assert track.outline is not None
    if not (track.rigid and track.outline.upright) or _drives(track):
        return
    if len(moves_along) >= _LEAST_POINTS:
        track.rigidity += _SHARE_GAIN * (float(moves_along.mean()) - track.rigidity)
    elif not points_show_whole(track, track.outline):
        track.rigidity *= 1 - _SHARE_GAIN
    if track.rigidity < _RIGID_SHARE:
        track.loosen()


def may_be_rigid(track: BodyTrack) -> bool:
    """Return whether a body that counts as one with limbs may turn out to be rigid.

    An upright one may not while points on its trunk tell how far away it is.
    """
    outline = track.outline
    if outline is None or track.rigid:
        return False
    return not _looks_like_a_person(outline) or not outline.depths.measured


def moves_as_one(track: BodyTrack, velocity: Float64Array, points: int) -> bool:
    """Return whether a group of points that moves at (3,) m/s shows that its body is rigid."""
    assert track.outline is not None
    person = _looks_like_a_person(track.outline)
    return not person or track.drive.note(velocity, points, track.age_s)


def _looks_like_a_person(outline: Outline) -> bool:
    """Return whether a body is upright; so is one of which only legs were in view.

    What the image's border leaves of them in the end may be as wide as it is high.
    """
    return outline.upright or outline.legs_seen


def judge_scatter(
    tracks: list[BodyTrack], points: TrackedPoints, motion: PooledMotion
) -> TrackedPoints:
    """Note how far the points on rigid bodies differ in how they move.

    If they rather lie on several things, such as people who walk side by side and what is seen
    between them, the body counts as one with limbs, and has no members.
    """
    obstacle = points.obstacle.copy()
    for track in [t for t in tracks if t.rigid and t.missed_s == 0]:
        mine = np.flatnonzero(obstacle == track.id)
        track.scatter = scatter_of(mine, motion, track.mean, track.recent)
        if track.scatter is not None and _are_several(track, track.scatter):
            track.loosen()
            obstacle[mine] = NO_OBSTACLE
    return points.but(obstacle=obstacle)


def _are_several(track: BodyTrack, scatter: Scatter) -> bool:
    """Return whether points taken for one body are on several.

    A confirmed body keeps its points, and where one gains speed or brakes they differ, too: each
    has been seen for another time.
    """
    tentative = track.state is TrackState.TENTATIVE and track.outline is not None
    many = scatter.points >= _MANY_POINTS and track.steady_s >= _STEADY_S
    return tentative and many and scatter.level_mps > _SCATTERED_MPS


def _drives(track: BodyTrack) -> bool:
    """Return whether more points have moved steadily as one, and for longer, than limbs do."""
    return track.by_points and track.points >= _MANY_POINTS and track.steady_s >= _STEADY_S


def points_show_whole(track: BodyTrack, outline: Outline) -> bool:
    """Return whether a rigid body's points lie all over its outline."""
    if track.points < _WHOLE_POINTS or not track.rigid:
        return False
    u0, v0, u1, v1 = track.box_px
    a0, b0, a1, b1 = outline.box_px
    return v1 - v0 > _WHOLE_HEIGHT * (b1 - b0) and u1 - u0 > _WHOLE_WIDTH * (a1 - a0)
