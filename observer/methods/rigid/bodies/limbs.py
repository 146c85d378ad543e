"""Tells bodies whose limbs move by themselves, people, from rigid ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.outline import Outline

# A body is rigid while this share of the points on it moves as it does; the share follows the
# newest frame so fast, of at least so many points. Who begins to walk is half still: taken for
# rigid, he would seem to go at the speed of what moves of him.
_RIGID_SHARE = 0.8
_SHARE_GAIN = 0.2
_LEAST_POINTS = 4
# So many points that moved as one for so many seconds are of no arm and no leg, but for instance of
# a robot with a mast on which nothing can be followed.
_MANY_POINTS, _STEADY_S = 12, 0.5
# Points show a whole body, if they are so many, over these shares of its height and width.
_WHOLE_POINTS, _WHOLE_HEIGHT, _WHOLE_WIDTH = 8, 0.75, 0.6


def judge_rigidity(track: BodyTrack, moves_along: NDArray[np.bool_]) -> None:
    """Learn from which of the points on a body (N,) move along whether its limbs do so.

    Only what stands upright may have limbs. A body that has turned out to have some keeps them,
    and is from now on measured by its trunk, whose yaw nothing shows.
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

    Of one that stands upright no points on the trunk may tell otherwise.
    """
    outline = track.outline
    if outline is None or track.rigid:
        return False
    return not outline.upright or not outline.depths.tell


def moves_as_one(track: BodyTrack, velocity: Float64Array, points: int) -> bool:
    """Return whether a group of points that moves at (3,) m/s tells that its body is rigid."""
    assert track.outline is not None
    return not track.outline.upright or track.drive.note(velocity, points, track.age_s)


def _drives(track: BodyTrack) -> bool:
    """Return whether so many points have moved steadily as one for so long as no limbs do."""
    return track.by_points and track.points >= _MANY_POINTS and track.steady_s >= _STEADY_S


def points_show_whole(track: BodyTrack, outline: Outline) -> bool:
    """Return whether a rigid body's points lie all over its outline."""
    if track.points < _WHOLE_POINTS or not track.rigid:
        return False
    u0, v0, u1, v1 = track.box_px
    a0, b0, a1, b1 = outline.box_px
    return v1 - v0 > _WHOLE_HEIGHT * (b1 - b0) and u1 - u0 > _WHOLE_WIDTH * (a1 - a0)
