"""Static points among those of a track: nothing moves there as a whole."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.static_among import note_static_points
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

from ..moving_points import motion
from ..solid_worlds import patch, points_on
from .judging import P, judge_frames

MakeTrack = Callable[..., BodyTrack]

PLACE = (0.0, 0.0, 3.0)
VELOCITY = np.array([0.0, 0.0, 0.3])
# Nine members on a square half a metre wide.
MEMBERS = patch(*PLACE, 0.5)


def noted(
    track: BodyTrack,
    others: Float64Array,
    velocity: Float64Array,
    owner: int = NO_OBSTACLE,
    within: int = NO_OBSTACLE,
) -> bool:
    """Note of a track with nine members, and other points at (N, 3) m that move at (3,) m/s.

    ``owner`` and ``within``: the bodies that the others belong to, and on which they are seen.
    """
    points = points_on(MEMBERS, others)
    owners = np.concatenate([np.full(len(MEMBERS), track.id), np.full(len(others), owner)])
    velocities = np.concatenate(
        [np.tile(track.mean[3:6], (len(MEMBERS), 1)), np.tile(velocity, (len(others), 1))]
    )
    seen = motion(np.concatenate([MEMBERS, others]), velocities)
    on = np.concatenate([np.full(len(MEMBERS), track.id), np.full(len(others), within)])
    note_static_points([track], points.but(obstacle=owners, within=on), seen)
    return track.among_static


@pytest.fixture
def track(make_track: MakeTrack) -> BodyTrack:
    return make_track(PLACE, tuple(VELOCITY))


def beside(across_m: float, depth_m: float = PLACE[2]) -> Float64Array:
    """(3, 3) m, places close to each other."""
    return np.array([[across_m + 0.02 * k, 0.05, depth_m] for k in range(3)])


def test_static_points_among_the_members_are_noted(track: BodyTrack) -> None:
    assert noted(track, beside(0.1), np.zeros(3))
    assert not noted(track, beside(0.1)[:2], np.zeros(3)), "two may be wrong"


def test_points_that_move_along_are_none(track: BodyTrack) -> None:
    assert not noted(track, beside(0.1), VELOCITY)


def test_points_beside_a_body_or_at_another_depth_are_not_among_its_own(track: BodyTrack) -> None:
    assert not noted(track, beside(0.4), np.zeros(3))
    assert not noted(track, beside(0.1, 5.0), np.zeros(3)), "seen through a gap"
    assert not noted(track, beside(0.1), np.zeros(3), owner=7), "on a robot that stands before it"
    assert not noted(track, beside(0.1), np.zeros(3), within=7), "on somebody who stands before it"
    assert noted(track, beside(0.1), np.zeros(3), within=track.id)


def test_points_whose_motion_is_uncertain_tell_nothing(make_track: MakeTrack) -> None:
    """Their velocity fits rest, but that of the body as well."""
    slow = make_track(PLACE, (0.0, 0.0, 0.04))
    assert not noted(slow, beside(0.1), np.zeros(3))


def test_a_track_that_is_reported_is_not_judged_again(track: BodyTrack) -> None:
    track.state = TrackState.CONFIRMED
    assert not noted(track, beside(0.1), np.zeros(3))


def test_limbs_may_rest_among_the_points_of_a_person(track: BodyTrack) -> None:
    assert noted(track, beside(0.1), np.zeros(3))
    track.rigid = False
    assert not noted(track, beside(0.1), np.zeros(3)), "known as a person since"


@pytest.mark.parametrize("among", [True, False])
def test_a_track_among_static_points_is_not_confirmed(
    make_track: MakeTrack, *, among: bool
) -> None:
    track = make_track(PLACE, (0.0, 0.0, 0.5), sigma=0.02)
    track.points, track.among_static = 9, among
    state = judge_frames(track, 2 * P.confirm_hits)
    assert state is (TrackState.TENTATIVE if among else TrackState.CONFIRMED)
