"""Predictions for the next frame, for bodies with known motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.expectation import predict
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.parameters import Parameters
from observer.types import TrackState

from ..solid_worlds import Solid, outline_of, step_to

MakeTrack = Callable[..., BodyTrack]
# To the right of the camera's axis, so that the line of sight is not a world axis.
AT = np.array([1.2, 0.0, 3.6])
SIGHT = AT / np.linalg.norm(AT)
ACROSS = np.array([SIGHT[2], 0.0, -SIGHT[0]])


@pytest.fixture
def walker(make_track: MakeTrack) -> Callable[..., BodyTrack]:
    """Gives a person seen as an outline, confirmed by default."""

    def make(*, measured: bool, state: TrackState = TrackState.CONFIRMED) -> BodyTrack:
        track = make_track(tuple(AT), (0.0, 0.0, -0.9))
        track.outline = outline_of(Solid(tuple(AT), (0.45, 1.2, 0.1)))
        track.outline.depths.measured = measured
        track.rigid, track.state = False, state
        return track

    return make


def doubt(track: BodyTrack, axis: Float64Array) -> float:
    """(m/s)^2 that one frame adds to the variance of the velocity along an axis (3,)."""
    before = track.filter.covariance[VELOCITY, VELOCITY].copy()
    predict([track], step_to(), Parameters().obstacles)
    return float(axis @ (track.filter.covariance[VELOCITY, VELOCITY] - before) @ axis)


def test_a_turning_body_without_points_is_uncertain_along_the_line_of_sight(
    walker: MakeTrack,
) -> None:
    with_points, without_points = (
        doubt(walker(measured=measured), SIGHT) for measured in (True, False)
    )
    assert without_points > 2.0 * with_points
    with_points, without_points = (
        doubt(walker(measured=measured), ACROSS) for measured in (True, False)
    )
    assert without_points == pytest.approx(with_points, rel=0.1)


def test_a_tentative_body_is_not_more_uncertain_without_points(walker: MakeTrack) -> None:
    """Otherwise a person coming straight on would never become certain to move."""
    with_points, without_points = (
        doubt(walker(measured=measured, state=TrackState.TENTATIVE), SIGHT)
        for measured in (True, False)
    )
    assert without_points == with_points


def test_a_person_may_turn_in_any_direction_regardless_of_limb_motion(walker: MakeTrack) -> None:
    aside = np.array([1.0, 0.0, 0.0])
    swung, calm = walker(measured=True), walker(measured=True)
    swung.shape.note_heading(aside, np.eye(3) * 1e-4, swung.yaw)
    for axis in (SIGHT, ACROSS):
        assert doubt(swung, axis) == pytest.approx(doubt(calm, axis))


def test_a_person_close_by_turns_as_fast_as_one_far_away(walker: MakeTrack) -> None:
    """In the image a robot's least acceleration is the same; a person's is in the world."""
    near, far = walker(measured=True), walker(measured=True)
    near.filter = near.filter.shifted(-0.6 * AT, np.zeros(3))
    assert doubt(near, ACROSS) == pytest.approx(doubt(far, ACROSS))
