"""Points that something nearer hides, and points at wrong depths, in worlds of boxes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.occlusion import at_wrong_depth, without_hidden
from observer.methods.rigid.tracked_points import NO_OBSTACLE

from ..solid_worlds import ROOM, Solid, patch, points_on, seen
from ..solid_worlds import step_to as now_at

MakeTrack = Callable[..., BodyTrack]
# Its left half is behind the crate, whose right edge is seen at x = 0.
ROBOT = Solid((0.0, 0.0, 4.1), (0.8, 0.5, 0.2))
CRATE = Solid((-0.5, 0.0, 2.6), (1.0, 0.9, 0.2))


def test_members_at_the_edge_of_what_hides_their_body_leave_it(make_track: MakeTrack) -> None:
    at_edge, clear = patch(0.01, 0.0, 4.0, side=0.01), patch(0.28, 0.0, 4.0, side=0.1)
    points = points_on(np.concatenate([at_edge, clear]))
    tracks = [make_track((0.0, 0.0, 4.1))]
    left = without_hidden(tracks, points, seen([*ROOM, ROBOT, CRATE]), now_at())
    assert (left.obstacle[:9] == NO_OBSTACLE).all()
    assert (left.tenure[:9] < 0).all()
    assert (left.obstacle[9:] == 1).all()


def test_members_at_the_edge_of_what_is_behind_stay(make_track: MakeTrack) -> None:
    points = points_on(patch(0.38, 0.0, 4.0, side=0.02))
    tracks = [make_track((0.0, 0.0, 4.1))]
    after = without_hidden(tracks, points, seen([*ROOM, ROBOT]), now_at())
    assert (after.obstacle == 1).all()


@pytest.mark.parametrize(("factor", "wrong"), [(1.0, False), (1.1, False), (2.5, True)])
def test_a_point_at_no_depth_around_it_is_wrong(factor: float, wrong: bool) -> None:
    points = points_on(patch(0.0, 0.0, 4.0))
    points = points.but(disparity=points.disparity * factor)
    assert (at_wrong_depth(points, seen([*ROOM, ROBOT])) == wrong).all()


def test_a_point_at_an_edge_may_be_at_either_depth() -> None:
    points = points_on(patch(0.4, 0.0, 4.0, side=0.01))
    _, behind = points.disparity, points.disparity * 4.0 / 8.0
    scene = seen([*ROOM, ROBOT, Solid((0.8, 0.0, 8.0), (0.8, 2.0, 0.2))])
    assert not at_wrong_depth(points, scene).any()
    assert not at_wrong_depth(points.but(disparity=behind), scene).any()


def test_where_depth_is_unknown_no_point_is_wrong() -> None:
    points = points_on(patch(0.0, 0.0, 4.0))
    assert not at_wrong_depth(points, None).any()
