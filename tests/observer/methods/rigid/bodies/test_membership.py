"""Which points join a body or leave it, and where they lie on it; their motion is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.membership import (
    joining,
    placed,
    resting,
    shape_position,
)
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import ObstacleParameters
from observer.types import MotionState

from ..moving_points import SIGMA, every, motion

MakeTrack = Callable[..., BodyTrack]
P = ObstacleParameters()


# --- joining -------------------------------------------------------------------------------


@pytest.fixture
def track(make_track: MakeTrack) -> BodyTrack:
    """A body at 3 m, 0.6 m long, that drives to the right at 0.3 m/s and turns."""
    return make_track(yaw=0.3, yaw_rate=0.6)


def on(track: BodyTrack, local: Float64Array) -> Float64Array:
    return track.mean[:3] + np.atleast_2d(local) @ track.R.T


def test_points_on_a_body_moving_with_it_join(track: BodyTrack) -> None:
    places = on(track, np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3)) * track.box.size)
    seen = motion(places, track.velocity_at(places))
    # Some near the centre of rotation move too little to be distinguished from static points.
    assert joining(track, every(seen), seen, P).mean() > 0.9


def test_points_at_rest_do_not_join(track: BodyTrack) -> None:
    seen = motion(on(track, np.zeros(3)), np.zeros(3))
    assert not joining(track, every(seen), seen, P).any()


@pytest.mark.parametrize("other", [(-0.3, 0, 0), (0.3, 0, 0.5), (0.3, 0.4, 0), (0.9, 0, 0)])
def test_points_with_a_different_motion_do_not_join(
    track: BodyTrack, other: tuple[float, float, float]
) -> None:
    seen = motion(on(track, np.zeros(3)), np.array(other))
    assert not joining(track, every(seen), seen, P).any()


def test_points_with_very_uncertain_motion_do_not_join(track: BodyTrack) -> None:
    """They fit the body, but equally well a static scene."""
    places = on(track, np.zeros(3))
    for sigma, joins in ((0.03, True), (0.3, False)):
        seen = motion(places, track.velocity_at(places), sigma)
        assert joining(track, every(seen), seen, P).tolist() == [joins]


def test_points_beside_the_box_do_not_join(track: BodyTrack) -> None:
    # The longest side is 0.6 m: a point may lie 0.09 m outside, plus a little for its noise.
    places = on(track, np.array([[0.2 + 0.08, 0, 0], [0.2 + 0.2, 0, 0], [0, 0, 0.3 + 0.2]]))
    seen = motion(places, track.velocity_at(places))
    assert joining(track, every(seen), seen, P).tolist() == [True, False, False]
    wide = ObstacleParameters(margin=0.5)
    assert joining(track, every(seen), seen, wide).all()


def test_only_free_points_are_considered(track: BodyTrack) -> None:
    places = on(track, np.zeros((4, 3)))
    velocity = track.velocity_at(places)
    velocity[1] = 0.0
    seen = motion(places, velocity)
    assert joining(track, np.array([1, 3]), seen, P).tolist() == [False, True]


def test_a_long_observed_point_may_lag_behind_a_turning_body(make_track: MakeTrack) -> None:
    """Its velocity is the mean over its window; half a window ago the body had another heading."""
    rate, window = 1.5, 0.6
    track = make_track(velocity=(0.6, 0, 0), yaw_rate=rate)
    before = yaw_matrix(-rate * window / 2) @ np.array([0.6, 0, 0])
    place = track.centre[None]
    seen = motion(place, before, 0.02, window)
    assert joining(track, every(seen), seen, P).all()
    steady = make_track(velocity=(0.6, 0, 0))
    assert not joining(steady, every(seen), motion(place, before, 0.02, 0.05), P).any()


def test_very_slow_points_do_not_join_an_uncertain_body(
    make_track: MakeTrack,
) -> None:
    """Points tracked along an edge creep; a body that turns and brakes could explain anything."""
    vague = make_track(velocity=(0.1, 0, 0), yaw_rate=1.5)
    creeping = motion(on(vague, np.zeros(3)), np.array([0.004, 0.0, 0.0]), 0.001)
    assert not joining(vague, every(creeping), creeping, P).any()


# --- leaving -------------------------------------------------------------------------------


def test_resting_members_are_found_at_the_centre_of_rotation(
    make_track: MakeTrack,
) -> None:
    # It turns about the point (0, 0, -0.5) m from its centre.
    turning = make_track(velocity=(0.4, 0, 0), yaw_rate=0.8)
    pivot = on(turning, np.array([0.0, 0.0, -0.5]))
    assert np.linalg.norm(turning.velocity_at(pivot)) < 1e-9
    seen = motion(pivot, np.zeros(3), 0.005)
    assert resting(turning, every(seen), seen).all()


def test_members_moving_with_the_body_are_not_resting(track: BodyTrack) -> None:
    places = on(track, np.random.default_rng(2).uniform(-0.5, 0.5, (30, 3)) * track.box.size)
    for sigma in (0.005, SIGMA):
        seen = motion(places, track.velocity_at(places), sigma)
        assert not resting(track, every(seen), seen).any()


@pytest.mark.parametrize("sigma", [0.005, 0.03, 0.2])
def test_members_of_a_stopped_body_do_not_count_as_resting(
    make_track: MakeTrack, sigma: float
) -> None:
    stopped = make_track(velocity=(0.0, 0, 0))
    seen = motion(on(stopped, np.zeros((5, 3))), np.zeros(3), sigma)
    assert not resting(stopped, every(seen), seen).any()


def test_noise_of_a_stopped_body_removes_no_members(make_track: MakeTrack) -> None:
    """Its points are known to rest, with a fraction of the body's own uncertainty."""
    stopped = make_track(velocity=(0.002, 0, 0), yaw_rate=-0.01)
    stopped.motion = MotionState.STOPPED
    seen = motion(on(stopped, np.zeros((5, 3))), np.zeros(3), 0.0003, 2.0)
    assert not resting(stopped, every(seen), seen).any()


def drove(track: BodyTrack, speeds: Float64Array, rate: float = 15.0) -> BodyTrack:
    """Let the body have driven to the right at these speeds, m/s, frame by frame up to now."""
    for k, speed in enumerate(speeds):
        track.recent.note(k / rate, np.array([speed, 0, 0]), 0.0)
    return track


def test_members_of_a_starting_body_need_not_move_on_average_yet(
    make_track: MakeTrack,
) -> None:
    """The velocity of a point seen for long hardly shows yet that its body has sped up."""
    ramp = np.concatenate([np.zeros(45), np.linspace(0, 0.1, 6)])
    begins = drove(make_track(velocity=(0.1, 0, 0)), ramp)
    seen = motion(on(begins, np.zeros((5, 3))), np.array([0.004, 0, 0]), 0.001, 1.5)
    assert not resting(begins, every(seen), seen).any()
    # A point that has not moved although its body has driven for long is not part of it.
    steady = drove(make_track(velocity=(0.1, 0, 0)), np.full(51, 0.1))
    assert resting(steady, every(seen), seen).all()
    # That the body stood before the point was first seen makes no difference.
    young = motion(on(begins, np.zeros((5, 3))), np.zeros(3), 0.001, 0.1)
    went = drove(make_track(velocity=(0.1, 0, 0)), np.concatenate([np.zeros(20), np.full(31, 0.1)]))
    assert resting(went, every(young), young).all()


def test_members_of_a_body_moving_back_and_forth_stay(make_track: MakeTrack) -> None:
    pulses = 0.15 * np.sign(np.sin(np.arange(50) / 15 * 2 * np.pi))
    back = drove(make_track(velocity=(pulses[-1], 0, 0)), pulses)
    seen = motion(on(back, np.zeros((5, 3))), np.array([0.13, 0, 0]), 0.002, 1.5)
    assert not resting(back, every(seen), seen).any()


def test_members_with_very_uncertain_motion_do_not_count_as_resting(track: BodyTrack) -> None:
    seen = motion(on(track, np.zeros((5, 3))), np.zeros(3), 0.3)
    assert not resting(track, every(seen), seen).any()
    sure = motion(on(track, np.zeros((5, 3))), np.zeros(3), 0.01)
    unjudged = replace(sure, judged=np.zeros(5, bool))
    assert resting(track, every(sure), sure).all()
    assert not resting(track, every(sure), unjudged).any()


# --- where points are on their body --------------------------------------------------------


@pytest.mark.parametrize("rate", [0.0, 0.8])
def test_points_are_placed_where_the_body_has_carried_them(
    rate: float, make_track: MakeTrack, sightings_of: Callable[..., PositionVelocityFilter]
) -> None:
    rng = np.random.default_rng(4)
    track = make_track(velocity=(0.5, 0, 0.2), yaw=0.4, yaw_rate=rate)
    local = rng.uniform(-0.3, 0.3, (25, 3))
    times = np.linspace(-0.5, 0, 9)
    places = []
    for t in times:
        # Back along the circle that ends at the current pose.
        arc = np.mean(
            [yaw_matrix(rate * t * s) @ track.mean[3:6] for s in np.linspace(0, 1, 201)], axis=0
        )
        origin = track.mean[:3] + t * arc
        places.append(origin + local @ yaw_matrix(track.yaw + rate * t).T)
    noisy = np.array(places) + rng.normal(0, 0.002, (9, 25, 3))
    sums = sightings_of(noisy, times.tolist(), 0.002)
    found, information = placed(track, sums)
    error = np.linalg.norm(found - places[-1], axis=1)
    assert np.median(error) < (0.003 if rate == 0 else 0.012)
    # Treated as static, they would be placed where they were half the window ago.
    at_rest, _ = sums.static_position()
    assert np.median(np.linalg.norm(at_rest - places[-1], axis=1)) > 0.08
    squared = np.einsum("ni,nij,nj->n", found - places[-1], information, found - places[-1])
    assert np.median(squared) < 7.8
    # Uncertainty about the turn makes the place less certain.
    sigma = np.sqrt(np.linalg.inv(information)[:, 0, 0])
    assert np.median(sigma) < 0.0015 if rate == 0 else np.median(sigma) > 0.005


def test_points_on_an_accelerating_body_are_placed_less_certainly(make_track: MakeTrack) -> None:
    """At their older sightings the body was slower than now."""
    eye = np.eye(3)[None] / 0.01**2
    sums = PositionVelocityFilter.begin(np.array([[0.2, 0, 3.0]]), eye)
    for _ in range(15):
        sums = sums.advanced(1 / 15, 1.0).with_sightings(np.array([[0.2, 0, 3.0]]), eye)
    steady = drove(make_track(velocity=(0.2, 0, 0)), np.full(51, 0.2))
    gained = drove(make_track(velocity=(0.2, 0, 0)), np.linspace(0, 0.2, 51))
    (sure,), (doubtful,) = (
        np.linalg.inv(placed(track, sums)[1])[:, 0, 0] for track in (steady, gained)
    )
    assert doubtful > sure + 0.005**2
    # The true error of the place, a s^2 / 2 averaged over the sightings, is within it.
    ages = np.arange(16) / 15
    weights = np.exp(-ages)
    error = 0.2 / (50 / 15) * np.average(ages**2 / 2, weights=weights)
    assert np.sqrt(doubtful) >= error


def test_the_position_of_a_point_follows_from_its_information() -> None:
    rng = np.random.default_rng(5)
    A = rng.normal(0, 1, (6, 3, 3))
    information = A @ np.swapaxes(A, 1, 2) + 10 * np.eye(3)
    local = rng.normal(0, 1, (6, 3))
    nothing = PositionVelocityFilter.begin(np.zeros((6, 3)), np.zeros((6, 3, 3)))
    px = np.zeros((6, 2), np.float32)
    points = TrackedPoints.begin(0, px, px, np.ones(6), nothing).but(
        shape_information=information,
        shape_vector=np.einsum("nij,nj->ni", information, local),
    )
    which = np.array([4, 0])
    np.testing.assert_allclose(shape_position(points, which), local[which])
