"""Points that something nearer hides, in worlds of boxes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.occlusion import without_hidden
from observer.vision.lifecycle import NO_OBSTACLE

from ..solid_worlds import ROOM, Solid, patch, points_on, seen
from ..solid_worlds import step_to as now_at

MakeTrack = Callable[..., BodyTrack]
# Its left half is behind the crate, whose right edge is seen at x = 0.
ROBOT = Solid((0.0, 0.0, 4.1), (0.8, 0.5, 0.2))
CRATE = Solid((-0.5, 0.0, 2.6), (1.0, 0.9, 0.2))


def test_members_at_the_edge_of_an_occluder_leave_their_body(make_track: MakeTrack) -> None:
    at_edge, clear = patch(0.01, 0.0, 4.0, side=0.01), patch(0.28, 0.0, 4.0, side=0.1)
    points = points_on(np.concatenate([at_edge, clear]))
    tracks = [make_track((0.0, 0.0, 4.1))]
    left = without_hidden(tracks, points, seen([*ROOM, ROBOT, CRATE]), now_at())
    assert (left.obstacle[:9] == NO_OBSTACLE).all()
    assert (left.tenure[:9] < 0).all()
    assert (left.obstacle[9:] == 1).all()


def test_members_at_the_edge_of_the_background_stay(make_track: MakeTrack) -> None:
    points = points_on(patch(0.38, 0.0, 4.0, side=0.02))
    tracks = [make_track((0.0, 0.0, 4.1))]
    after = without_hidden(tracks, points, seen([*ROOM, ROBOT]), now_at())
    assert (after.obstacle == 1).all()
