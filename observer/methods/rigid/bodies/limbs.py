"""Tells bodies whose limbs move by themselves, people, from rigid ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.outline import Outline

# A body is rigid while this share of the points on it moves as it does; the share follows the
# newest frame so fast, of at least so many points. Who begins to walk is half still: taken for
# rigid, he would seem to go at the speed of what moves of him.
_RIGID_SHARE = 0.8
_SHARE_GAIN = 0.2
_LEAST_POINTS = 4
# Points show a whole body, if they are so many, over these shares of its height and width.
_WHOLE_POINTS, _WHOLE_HEIGHT, _WHOLE_WIDTH = 8, 0.75, 0.6


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
