"""Which points belong to which body, for points and bodies whose motion is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.membership import (
    Group,
    are_one,
    body_of,
    goes_with,
    group_of,
    joining,
    placed,
    resting,
    shape_position,
)
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import ObstacleParameters
from observer.types import MotionState, TrackState

MakeTrack = Callable[..., BodyTrack]
P = ObstacleParameters()
# How well a point's own velocity is known, m/s.
SIGMA = 0.03
REACH_M = 0.15


def motion(
    places: Float64Array, velocity: Float64Array, sigma: float = SIGMA, window_s: float = 0.5
) -> PooledMotion:
    """Points (N, 3) m that are known to move at (N, 3) m/s."""
    count = len(places)
    velocity = np.broadcast_to(velocity, (count, 3)).astype(float)
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))
    return PooledMotion(
        own_velocity=velocity,
        own_information=eye / sigma**2,
        judged=np.ones(count, bool),
        window_s=np.full(count, window_s),
        position=np.asarray(places, float),
        position_cov=eye * 0.01**2,
        shared_cov=eye * 0.0,
        velocity=velocity,
        covariance=eye * sigma**2,
        significance=np.full(count, 10.0),
        neighbours=np.full(count, 5),
        threshold=5.0,
        dynamic=np.ones(count, bool),
        pairs=np.zeros((0, 2), np.intp),
    )


def every(points: PooledMotion) -> np.ndarray:
    return np.arange(len(points.position))


# --- joining -------------------------------------------------------------------------------


@pytest.fixture
def track(make_track: MakeTrack) -> BodyTrack:
    """At 3 m, drives to the right at 0.3 m/s and turns; 0.6 m long."""
    return make_track(yaw=0.3, yaw_rate=0.6)


def on(track: BodyTrack, local: Float64Array) -> Float64Array:
    return track.mean[:3] + np.atleast_2d(local) @ track.R.T


def test_points_on_a_body_that_move_with_it_join(track: BodyTrack) -> None:
    places = on(track, np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3)) * track.box.size)
    seen = motion(places, track.velocity_at(places))
    # Of those about which it turns some move too little to be told from what rests.
    assert joining(track, every(seen), seen, P).mean() > 0.9


def test_points_at_rest_do_not_join(track: BodyTrack) -> None:
    seen = motion(on(track, np.zeros(3)), np.zeros(3))
    assert not joining(track, every(seen), seen, P).any()


@pytest.mark.parametrize("other", [(-0.3, 0, 0), (0.3, 0, 0.5), (0.3, 0.4, 0), (0.9, 0, 0)])
def test_points_that_move_otherwise_do_not_join(
    track: BodyTrack, other: tuple[float, float, float]
) -> None:
    seen = motion(on(track, np.zeros(3)), np.array(other))
    assert not joining(track, every(seen), seen, P).any()


def test_points_whose_motion_is_hardly_known_do_not_join(track: BodyTrack) -> None:
    """They fit the body, but they fit standing still as well."""
    places = on(track, np.zeros(3))
    for sigma, joins in ((0.03, True), (0.3, False)):
        seen = motion(places, track.velocity_at(places), sigma)
        assert joining(track, every(seen), seen, P).tolist() == [joins]


def test_points_beside_the_box_do_not_join(track: BodyTrack) -> None:
    # The longest side is 0.6 m: by 0.09 m a point may lie outside, and a little more by its noise.
    places = on(track, np.array([[0.2 + 0.08, 0, 0], [0.2 + 0.2, 0, 0], [0, 0, 0.3 + 0.2]]))
    seen = motion(places, track.velocity_at(places))
    assert joining(track, every(seen), seen, P).tolist() == [True, False, False]
    wide = ObstacleParameters(margin=0.5)
    assert joining(track, every(seen), seen, wide).all()


def test_only_the_free_points_are_asked(track: BodyTrack) -> None:
    places = on(track, np.zeros((4, 3)))
    velocity = track.velocity_at(places)
    velocity[1] = 0.0
    seen = motion(places, velocity)
    assert joining(track, np.array([1, 3]), seen, P).tolist() == [False, True]


def test_a_point_seen_for_long_may_lag_behind_a_body_that_turns(make_track: MakeTrack) -> None:
    """Its velocity is the mean over its window; half a window ago the body drove elsewhere."""
    rate, window = 1.5, 0.6
    track = make_track(velocity=(0.6, 0, 0), yaw_rate=rate)
    before = yaw_matrix(-rate * window / 2) @ np.array([0.6, 0, 0])
    place = track.centre[None]
    seen = motion(place, before, 0.02, window)
    assert joining(track, every(seen), seen, P).all()
    steady = make_track(velocity=(0.6, 0, 0))
    assert not joining(steady, every(seen), motion(place, before, 0.02, 0.05), P).any()


def test_points_that_creep_do_not_join_a_body_of_which_little_is_known(
    make_track: MakeTrack,
) -> None:
    """What is followed along an edge creeps; a body that turns and brakes explains anything."""
    vague = make_track(velocity=(0.1, 0, 0), yaw_rate=1.5)
    creeping = motion(on(vague, np.zeros(3)), np.array([0.004, 0.0, 0.0]), 0.001)
    assert not joining(vague, every(creeping), creeping, P).any()


# --- leaving -------------------------------------------------------------------------------


def test_members_that_rest_are_found_also_where_the_body_turns_about_them(
    make_track: MakeTrack,
) -> None:
    # About the point (0, 0, -0.5) m from its centre.
    turning = make_track(velocity=(0.4, 0, 0), yaw_rate=0.8)
    pivot = on(turning, np.array([0.0, 0.0, -0.5]))
    assert np.linalg.norm(turning.velocity_at(pivot)) < 1e-9
    seen = motion(pivot, np.zeros(3), 0.005)
    assert resting(turning, every(seen), seen).all()


def test_members_that_move_with_it_do_not_rest(track: BodyTrack) -> None:
    places = on(track, np.random.default_rng(2).uniform(-0.5, 0.5, (30, 3)) * track.box.size)
    for sigma in (0.005, SIGMA):
        seen = motion(places, track.velocity_at(places), sigma)
        assert not resting(track, every(seen), seen).any()


@pytest.mark.parametrize("sigma", [0.005, 0.03, 0.2])
def test_the_members_of_a_body_that_stopped_are_none_that_rest(
    make_track: MakeTrack, sigma: float
) -> None:
    stopped = make_track(velocity=(0.0, 0, 0))
    seen = motion(on(stopped, np.zeros((5, 3))), np.zeros(3), sigma)
    assert not resting(stopped, every(seen), seen).any()


def test_noise_of_a_body_that_stopped_drives_nobody_away(make_track: MakeTrack) -> None:
    """Its points are known to rest, to a fraction of what the body itself is known to."""
    stopped = make_track(velocity=(0.002, 0, 0), yaw_rate=-0.01)
    stopped.motion = MotionState.STOPPED
    seen = motion(on(stopped, np.zeros((5, 3))), np.zeros(3), 0.0003, 2.0)
    assert not resting(stopped, every(seen), seen).any()


def drove(track: BodyTrack, speeds: Float64Array, rate: float = 15.0) -> BodyTrack:
    """To the right at these speeds, m/s, frame by frame up to now."""
    for k, speed in enumerate(speeds):
        track.recent.note(k / rate, np.array([speed, 0, 0]), 0.0)
    return track


def test_members_of_a_body_that_begins_to_move_need_not_move_on_average_yet(
    make_track: MakeTrack,
) -> None:
    """A point seen for long hardly knows yet that its body has gained speed."""
    ramp = np.concatenate([np.zeros(45), np.linspace(0, 0.1, 6)])
    begins = drove(make_track(velocity=(0.1, 0, 0)), ramp)
    seen = motion(on(begins, np.zeros((5, 3))), np.array([0.004, 0, 0]), 0.001, 1.5)
    assert not resting(begins, every(seen), seen).any()
    # What has not moved although its body has driven for long is none of it.
    steady = drove(make_track(velocity=(0.1, 0, 0)), np.full(51, 0.1))
    assert resting(steady, every(seen), seen).all()
    # Nor does it help that the body stood before the point was seen.
    young = motion(on(begins, np.zeros((5, 3))), np.zeros(3), 0.001, 0.1)
    went = drove(make_track(velocity=(0.1, 0, 0)), np.concatenate([np.zeros(20), np.full(31, 0.1)]))
    assert resting(went, every(young), young).all()


def test_members_of_a_body_that_goes_to_and_fro_stay(make_track: MakeTrack) -> None:
    pulses = 0.15 * np.sign(np.sin(np.arange(50) / 15 * 2 * np.pi))
    back = drove(make_track(velocity=(pulses[-1], 0, 0)), pulses)
    seen = motion(on(back, np.zeros((5, 3))), np.array([0.13, 0, 0]), 0.002, 1.5)
    assert not resting(back, every(seen), seen).any()


def test_of_members_of_which_little_is_known_none_rests(track: BodyTrack) -> None:
    seen = motion(on(track, np.zeros((5, 3))), np.zeros(3), 0.3)
    assert not resting(track, every(seen), seen).any()
    sure = motion(on(track, np.zeros((5, 3))), np.zeros(3), 0.01)
    unjudged = replace(sure, judged=np.zeros(5, bool))
    assert resting(track, every(sure), sure).all()
    assert not resting(track, every(sure), unjudged).any()


# --- groups --------------------------------------------------------------------------------


def test_a_group_moves_as_its_points_do_on_the_whole() -> None:
    rng = np.random.default_rng(1)
    places = np.array([0.2, 0, 3]) + rng.uniform(-0.2, 0.2, (12, 3))
    draws = []
    for _ in range(300):
        seen = motion(places, np.array([0.3, 0, -0.1]) + rng.normal(0, SIGMA, (12, 3)))
        group = group_of(every(seen), seen, P)
        assert group is not None
        draws.append(group.velocity)
    assert group.members.tolist() == list(range(12))
    np.testing.assert_allclose(group.places, places)
    np.testing.assert_allclose(group.centre, np.median(places, axis=0))
    np.testing.assert_allclose(np.mean(draws, axis=0), [0.3, 0, -0.1], atol=0.003)
    # The points share errors: the mean is less certain than if each had its own.
    stated = np.diag(group.velocity_cov)
    assert (stated > 1.5 * np.var(draws, axis=0)).all()
    assert (stated < SIGMA**2).all()


def test_better_known_points_count_more() -> None:
    places = np.array([[0.1 * k, 0, 3] for k in range(4)], float)
    velocity = np.array([[0.4, 0, 0]] + [[0.1, 0, 0]] * 3)
    seen = motion(places, velocity)
    seen.own_information[0] *= 100
    group = group_of(every(seen), seen, P)
    assert group is not None
    assert group.velocity[0] == pytest.approx((100 * 0.4 + 3 * 0.1) / 103)


def test_strays_are_left_out_of_a_group() -> None:
    rng = np.random.default_rng(2)
    places = np.array([0.2, 0, 3]) + rng.normal(0, 0.05, (12, 3))
    places[[3, 7]] += [[1.5, 0, 0], [0, 0, 2.0]]
    seen = motion(places, np.array([0.3, 0, 0]))
    group = group_of(every(seen), seen, P)
    assert group is not None
    assert not {3, 7} & set(group.members.tolist())
    assert len(group.members) >= 8


def test_too_few_are_no_group() -> None:
    places = np.array([[0.0, 0, 3], [0.1, 0.1, 3.05], [0.05, 0.05, 3.1]])
    seen = motion(places, np.array([0.3, 0, 0]))
    assert group_of(every(seen), seen, P) is not None
    assert group_of(np.array([0, 1]), seen, P) is None
    assert group_of(every(seen), seen, ObstacleParameters(min_points=4)) is None


def grouped(centre: tuple[float, float, float], velocity: tuple[float, float, float]) -> Group:
    rng = np.random.default_rng(3)
    places = np.array(centre) + rng.uniform(-0.1, 0.1, (15, 3))
    group = group_of(np.arange(15), motion(places, np.array(velocity)), P)
    assert group is not None
    return group


def test_a_group_belongs_to_the_nearest_body_that_moves_as_it_does(make_track: MakeTrack) -> None:
    near, far = make_track((0, 0, 3), number=1), make_track((0.5, 0, 3), number=2)
    other = make_track((0.05, 0, 3), (-0.3, 0, 0), number=3)
    tracks = [far, near, other]
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), tracks) is near
    assert body_of(grouped((0.45, 0, 3), (0.3, 0, 0)), tracks) is far
    assert body_of(grouped((0.1, 0, 3), (-0.3, 0, 0)), tracks) is other
    assert body_of(grouped((0.1, 0, 3), (-0.3, 0, 0)), [near, far]) is None
    assert body_of(grouped((2.0, 0, 3), (0.3, 0, 0)), tracks) is None
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), []) is None


def test_points_on_a_body_go_with_it_only_as_fast_as_it_is_known_to_be(
    make_track: MakeTrack,
) -> None:
    """Those of a limb that swings, or that slide off its edge, are faster."""
    for sigma, speed, goes in ((0.03, 0.95, True), (0.03, 1.8, False), (0.5, 1.8, True)):
        track = make_track((0, 0, 3), (0.9, 0, 0), sigma=sigma)
        assert goes_with(track, grouped((0.1, 0, 3), (speed, 0, 0))) is goes


def test_a_body_whose_place_is_uncertain_is_looked_for_farther_away(make_track: MakeTrack) -> None:
    group = grouped((1.2, 0, 3), (0.3, 0, 0))
    assert body_of(group, [make_track()]) is None
    hidden = make_track(sigma=0.01)
    hidden.filter.covariances[:, :3, :3] = np.eye(3) * 0.4**2
    assert body_of(group, [hidden]) is hidden


def test_a_body_may_have_turned_a_little_while_it_was_hidden(make_track: MakeTrack) -> None:
    for angle, same in ((0.0, True), (0.4, True), (np.pi, False)):
        velocity = yaw_matrix(angle) @ [0.3, 0, 0]
        found = body_of(grouped((0.1, 0, 3), tuple(velocity)), [make_track()])
        assert (found is not None) == same


def test_what_rests_is_no_part_of_a_body_however_little_is_known_of_it(
    make_track: MakeTrack,
) -> None:
    """After a second out of sight a body may be nearly anywhere and drive nearly anyhow."""
    vague = make_track(velocity=(0.4, 0, 0))
    vague.filter.covariances[:, :3, :3] = np.eye(3) * 0.3**2
    vague.filter.covariances[:, 3:6, 3:6] = np.eye(3) * 0.12**2
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), [vague]) is vague
    assert body_of(grouped((0.1, 0, 3), (0.0, 0, 0)), [vague]) is None
    resting_one = make_track((0.1, 0, 3), (0.0, 0, 0), number=2)
    assert not are_one(vague, resting_one, REACH_M, P)
    assert are_one(vague, make_track((0.1, 0, 3), (0.35, 0, 0), number=2), REACH_M, P)


def test_what_steps_below_a_trunk_is_its_leg(make_track: MakeTrack) -> None:
    """A foot at 1.9 m/s below somebody who walks at 0.6 m/s; not what is beside them or known."""
    walker = make_track(velocity=(0.6, 0, 0), box=Box(np.zeros(3), np.array([0.5, 1.7, 0.3]), 0.0))
    walker.rigid = False

    def foot(*place: float) -> BodyTrack:
        small = Box(np.zeros(3), np.array([0.3, 0.15, 0.1]), 0.0)
        return make_track(place, (1.9, 0, 0), number=2, box=small)

    assert are_one(walker, foot(0.3, 0.75, 3.2), REACH_M, P)
    for elsewhere in ((1.0, 0.75, 3.0), (0.1, 0.75, 4.0), (0.3, -0.2, 3.2)):
        assert not are_one(walker, foot(*elsewhere), REACH_M, P)
    known = foot(0.3, 0.75, 3.2)
    known.state = TrackState.CONFIRMED
    assert not are_one(walker, known, REACH_M, P)
    walker.rigid = True
    assert not are_one(walker, foot(0.3, 0.75, 3.2), REACH_M, P)


# --- one body or two -----------------------------------------------------------------------


def test_two_tracks_in_one_place_that_move_alike_are_one(make_track: MakeTrack) -> None:
    older = make_track()
    assert are_one(older, make_track((0.15, 0, 3.1), number=2), REACH_M, P)
    assert not are_one(older, make_track((0.15, 0, 3.1), (-0.3, 0, 0), number=2), REACH_M, P)
    assert not are_one(older, make_track((0.15, 0, 3.1), (0, 0, 0.4), number=2), REACH_M, P)


def test_two_that_drive_beside_each_other_are_two(make_track: MakeTrack) -> None:
    assert not are_one(make_track(), make_track((0, 0, 4.5), number=2), REACH_M, P)
    assert not are_one(make_track(), make_track((1.2, 0, 3), number=2), REACH_M, P)


@pytest.mark.parametrize(("apart_m", "seen", "same"), [(1.1, True, False), (1.1, False, True),
                                                       (0.5, True, True)])  # fmt: skip
def test_two_who_stand_beside_each_other_stay_two_while_both_are_seen(
    make_track: MakeTrack, apart_m: float, seen: bool, same: bool
) -> None:
    """Both at rest, and so tall that either lies within the room that the other may need."""
    boxes = [Box(np.zeros(3), np.array([0.5, 1.8, 0.3]), 0.0) for _ in range(2)]
    older = make_track(velocity=(0, 0, 0), box=boxes[0])
    other = make_track((apart_m, 0, 3.0), (0, 0, 0), number=2, box=boxes[1])
    for track in (older, other):
        track.outline = SimpleNamespace(seen=seen)  # type: ignore[assignment]
    assert are_one(older, other, REACH_M, P) is same


@pytest.mark.parametrize(("apart_m", "same"), [(1.1, False), (0.5, True)])
def test_who_is_out_of_sight_does_not_take_the_name_of_somebody_else_who_was_reported(
    make_track: MakeTrack, apart_m: float, same: bool
) -> None:
    """However little is known of how the one moves by now."""
    boxes = [Box(np.zeros(3), np.array([0.5, 1.8, 0.3]), 0.0) for _ in range(2)]
    hidden = make_track(velocity=(0, 0, 0), box=boxes[0], sigma=0.5)
    other = make_track((apart_m, 0, 3.0), (0.3, 0, 0), number=2, box=boxes[1])
    for track, seen in ((hidden, False), (other, True)):
        track.outline = SimpleNamespace(seen=seen)  # type: ignore[assignment]
    hidden.state = TrackState.COASTING
    # Who is not reported yet may be the one who was hidden.
    assert are_one(hidden, other, REACH_M, P)
    other.state = TrackState.CONFIRMED
    assert are_one(hidden, other, REACH_M, P) is same


def test_the_end_of_a_turning_body_may_move_the_other_way(make_track: MakeTrack) -> None:
    box = Box(np.zeros(3), np.array([1.0, 0.3, 1.2]), 0.0)
    turning = make_track(velocity=(0.6, 0, 0), yaw_rate=1.2, box=box)
    at = np.array([0, 0, 2.0])
    end = make_track(tuple(at), tuple(turning.velocity_at(at)), number=2)
    assert end.mean[3] == pytest.approx(-0.6)
    assert are_one(turning, end, REACH_M, P)
    assert not are_one(make_track(velocity=(0.6, 0, 0), box=box), end, REACH_M, P)


def test_what_has_no_box_yet_is_not_merged(make_track: MakeTrack) -> None:
    older, younger = make_track(), make_track(number=2)
    younger.box = None
    assert not are_one(older, younger, REACH_M, P)
    assert not are_one(younger, older, REACH_M, P)


# --- where points are on their body --------------------------------------------------------


@pytest.mark.parametrize("rate", [0.0, 0.8])
def test_points_are_placed_where_the_body_has_taken_them(
    rate: float, make_track: MakeTrack, sightings_of: Callable[..., PositionVelocityFilter]
) -> None:
    rng = np.random.default_rng(4)
    track = make_track(velocity=(0.5, 0, 0.2), yaw=0.4, yaw_rate=rate)
    local = rng.uniform(-0.3, 0.3, (25, 3))
    times = np.linspace(-0.5, 0, 9)
    places = []
    for t in times:
        # Back along the circle that ends here.
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
    # If they were taken to rest, they would lie where they were half the time ago.
    at_rest, _ = sums.static_position()
    assert np.median(np.linalg.norm(at_rest - places[-1], axis=1)) > 0.08
    squared = np.einsum("ni,nij,nj->n", found - places[-1], information, found - places[-1])
    assert np.median(squared) < 7.8
    # A turn that may have been another one makes the place less certain.
    sigma = np.sqrt(np.linalg.inv(information)[:, 0, 0])
    assert np.median(sigma) < 0.0015 if rate == 0 else np.median(sigma) > 0.005


def test_where_a_body_has_gained_speed_points_are_placed_with_doubt(make_track: MakeTrack) -> None:
    """For their older sightings it was slower than it is."""
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


def test_a_points_place_is_what_its_information_says() -> None:
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
