"""How far the points on a body differ in how they move, for points whose motion is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.expectation import note_lasting_errors
from observer.methods.rigid.bodies.filter import turning_velocity
from observer.methods.rigid.bodies.limbs import judge_scatter
from observer.methods.rigid.bodies.recent_motion import RecentMotion
from observer.methods.rigid.bodies.scatter import Scatter, scatter_of
from observer.methods.rigid.point_motion import PooledMotion
from observer.parameters import EvidenceParameters
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

from ..moving_points import SIGMA, every, motion
from ..solid_worlds import Solid, outline_of, points_on, step_to

MakeTrack = Callable[..., BodyTrack]


def state(velocity: Float64Array) -> Float64Array:
    """A filter's mean: a body at the origin that does not turn."""
    return np.concatenate([np.zeros(3), velocity, [0.0, 0.0]])


def moved_at(velocity: Float64Array, yaw_rate: float = 0.0) -> RecentMotion:
    recent = RecentMotion()
    for k in range(30):
        recent.note(k / 15, velocity, yaw_rate)
    return recent


def cloud(count: int, seed: int = 0) -> Float64Array:
    return np.random.default_rng(seed).uniform(-0.4, 0.4, (count, 3))


@given(
    yaw_rate=st.floats(-1.0, 1.0),
    velocity=st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array),
)
@settings(max_examples=25)
def test_points_on_a_body_that_turns_do_not_scatter(
    yaw_rate: float, velocity: Float64Array
) -> None:
    places = cloud(20)
    seen = motion(places, velocity + turning_velocity(yaw_rate, places))
    scatter = scatter_of(every(seen), seen, state(velocity), moved_at(velocity, yaw_rate))
    assert scatter is not None
    assert scatter.spread == pytest.approx(np.zeros(3), abs=1e-9)
    assert scatter.excess == 1.0
    assert scatter.doubt(np.eye(3)) == pytest.approx(np.zeros((3, 3)), abs=1e-12)


@given(spread=st.floats(0.05, 1.0), seed=st.integers(0, 1000))
@settings(max_examples=25)
def test_the_scatter_is_the_spread_of_the_velocities(spread: float, seed: int) -> None:
    velocity = np.array([0.3, 0.0, -0.2])
    own = np.random.default_rng(seed).normal(velocity, spread, (400, 3))
    seen = motion(cloud(400), own)
    scatter = scatter_of(every(seen), seen, state(velocity), moved_at(velocity))
    assert scatter is not None
    assert scatter.points == 400
    assert scatter.spread == pytest.approx(np.full(3, spread), rel=0.25)
    assert scatter.level_mps == pytest.approx(np.hypot(*scatter.spread[[0, 2]]))
    assert scatter.excess == pytest.approx(max(1.0, (spread / SIGMA) ** 2), rel=0.3)


def test_a_few_points_that_are_far_off_do_not_count() -> None:
    velocity = np.array([0.3, 0.0, 0.0])
    own = np.tile(velocity, (20, 1))
    own[:5] += 9.0
    seen = motion(cloud(20), own)
    scatter = scatter_of(every(seen), seen, state(velocity), moved_at(velocity))
    assert scatter is not None
    assert not scatter.spread.any()
    assert scatter.excess == 1.0


def test_the_median_of_points_is_as_uncertain_as_the_scatter_says() -> None:
    """If neighbours err alike in pairs, as the scatter assumes."""
    rng = np.random.default_rng(0)
    errors = np.repeat(rng.normal(0, 0.5, (2000, 20)), 2, axis=1)
    actual = np.std(np.median(errors, axis=1))
    scatter = Scatter(40, np.full(3, 0.5), excess=100.0)
    assert np.sqrt(scatter.doubt(np.eye(3))[0, 0]) == pytest.approx(actual, rel=0.1)


def test_scatter_that_noise_explains_adds_no_doubt() -> None:
    """A filter that averages over longer than the points are remembered is surer than they are."""
    scatter = Scatter(40, np.full(3, 0.5), excess=1.0)
    assert not scatter.doubt(np.eye(3) * 1e-4).any()
    # Three times the variance, of which one is known.
    scatter = Scatter(40, np.full(3, 0.5), excess=3.0)
    assert scatter.doubt(np.eye(3) * 1e-4) == pytest.approx(np.eye(3) * 2e-4)


def test_a_body_that_brakes_does_not_scatter() -> None:
    """Points seen over different times then have different mean velocities."""
    recent = RecentMotion()
    for k in range(31):
        recent.note(k / 15, np.array([2.0 - k / 15, 0.0, 0.0]), 0.0)
    window = np.linspace(0.2, 2.0, 40)
    own = np.zeros((40, 3))
    # A point's own velocity may be that at any instant in the middle half of its window.
    own[:, 0] = window * np.random.default_rng(0).uniform(0.25, 0.75, 40)
    seen = replace(motion(cloud(40), own), window_s=window)
    scatter = scatter_of(every(seen), seen, state(np.zeros(3)), recent)
    assert scatter is not None
    assert scatter.level_mps < 0.05


def test_little_is_known_of_few_or_new_points() -> None:
    velocity = np.array([0.3, 0.0, 0.0])
    few, many = motion(cloud(5), velocity), motion(cloud(20), velocity)
    assert scatter_of(every(few), few, state(velocity), moved_at(velocity)) is None
    assert scatter_of(every(many), many, state(velocity), RecentMotion()) is None
    unjudged = replace(many, judged=np.zeros(20, np.bool_))
    assert scatter_of(every(many), unjudged, state(velocity), moved_at(velocity)) is None


def test_points_that_were_seen_before_their_body_was_found_do_not_count() -> None:
    """It stood until a moment ago, and so did they."""
    velocity = np.array([0.8, 0.0, 0.0])
    recent = RecentMotion()
    for k in range(4):
        recent.note(k / 15, velocity, 0.0)
    own = np.random.default_rng(0).uniform(0.0, 1.0, (40, 1)) * velocity
    for window_s, known in ((0.5, False), (0.3, True)):
        seen = motion(cloud(40), own, window_s=window_s)
        assert (scatter_of(every(seen), seen, state(velocity), recent) is not None) is known


# --- what follows --------------------------------------------------------------------------


@pytest.fixture
def pair(make_track: MakeTrack) -> BodyTrack:
    """A body supposed to be rigid: two people who approach, and the wall between them."""
    track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -0.3))
    track.outline = outline_of(Solid((0.0, 0.0, 4.0), (1.2, 1.6, 0.1)))
    track.steady_s = 0.6
    for k in range(30):
        track.recent.note(k / 15, track.mean[3:6], 0.0)
    return track


def on_pair(track: BodyTrack, spread: float, count: int = 60) -> tuple[PooledMotion, Float64Array]:
    places = np.array([0.0, 0.0, 4.0]) + cloud(count)
    own = np.tile(track.mean[3:6], (count, 1))
    own[:, 2] += np.random.default_rng(1).normal(0, spread, count)
    return motion(places, own), places


@pytest.mark.parametrize(
    ("spread", "count", "state", "rigid"),
    [
        (0.9, 60, TrackState.TENTATIVE, False),
        (0.3, 60, TrackState.TENTATIVE, True),
        (0.9, 10, TrackState.TENTATIVE, True),
        (0.9, 60, TrackState.CONFIRMED, True),
    ],
)
def test_points_on_several_things_are_not_one_rigid_body(
    pair: BodyTrack, spread: float, count: int, state: TrackState, rigid: bool
) -> None:
    pair.state = state
    seen, places = on_pair(pair, spread, count)
    points = points_on(places).but(obstacle=np.full(count, pair.id))
    points = judge_scatter([pair], points, seen)
    assert pair.rigid is rigid
    assert set(points.obstacle.tolist()) == {pair.id if rigid else NO_OBSTACLE}
    # Limbs say nothing of how sure the trunk is.
    assert (pair.scatter is not None) is rigid


def test_points_on_a_body_that_gains_speed_may_differ(pair: BodyTrack) -> None:
    pair.steady_s = 0.2
    seen, places = on_pair(pair, 0.9)
    judge_scatter([pair], points_on(places).but(obstacle=np.full(len(places), pair.id)), seen)
    assert pair.rigid


@pytest.mark.parametrize("state", [TrackState.CONFIRMED, TrackState.TENTATIVE])
def test_the_stated_velocity_is_no_surer_than_its_points_agree(
    pair: BodyTrack, state: TrackState
) -> None:
    pair.state, doubts = state, []
    for spread in (0.0, 0.5):
        seen, places = on_pair(pair, spread)
        points = points_on(places).but(obstacle=np.full(len(places), pair.id))
        judge_scatter([pair], points, seen)
        note_lasting_errors([pair], step_to(), EvidenceParameters())
        doubts.append(pair.lasting_cov[2, 2])
    assert pair.scatter is not None
    known = pair.scatter.doubt(pair.filter.covariance[3:6, 3:6])[2, 2]
    assert known > 0.01**2
    expected = known if state is TrackState.CONFIRMED else 0.0
    assert doubts[1] - doubts[0] == pytest.approx(expected)


def test_a_body_out_of_sight_keeps_its_scatter(pair: BodyTrack) -> None:
    seen, places = on_pair(pair, 0.2)
    points = points_on(places).but(obstacle=np.full(len(places), pair.id))
    judge_scatter([pair], points, seen)
    known = pair.scatter
    pair.missed_s = 0.1
    judge_scatter([pair], points_on(places), seen)
    assert pair.scatter is known
