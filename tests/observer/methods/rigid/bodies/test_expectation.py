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

    def make(*, tells: bool, state: TrackState = TrackState.CONFIRMED) -> BodyTrack:
        track = make_track(tuple(AT), (0.0, 0.0, -0.9))
        track.outline = outline_of(Solid(tuple(AT), (0.45, 1.2, 0.1)))
        track.outline.depths.measured = tells
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
    told, untold = (doubt(walker(tells=tells), SIGHT) for tells in (True, False))
    assert untold > 2.0 * told
    told, untold = (doubt(walker(tells=tells), ACROSS) for tells in (True, False))
    assert untold == pytest.approx(told, rel=0.1)


def test_a_tentative_body_is_no_more_uncertain_for_that(walker: MakeTrack) -> None:
    """Otherwise somebody coming straight on would never become certain to move."""
    told, untold = (
        doubt(walker(tells=tells, state=TrackState.TENTATIVE), SIGHT) for tells in (True, False)
    )
    assert untold == told


def test_a_person_stops_and_starts_more_than_turns_aside(walker: MakeTrack) -> None:
    """Whatever a limb seemed to do before it was known to be one."""
    ahead, aside = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])

    def ratio(significance: float) -> float:
        walkers = [walker(tells=True), walker(tells=True)]
        for track in walkers:
            track.shape.note_heading(aside, np.eye(3) * 1e-4, track.yaw)
            track.significance = significance
        return doubt(walkers[0], ahead) / doubt(walkers[1], aside)

    assert ratio(10.0) == pytest.approx(4.0, rel=0.05)
    assert ratio(2.0) == pytest.approx(1.0, rel=0.05)
