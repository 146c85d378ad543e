"""Points that move alike, the body they belong to, and tracks that are one body."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.groups import Group, group_of
from observer.methods.rigid.bodies.identity import are_one, body_of, goes_with
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.parameters import ObstacleParameters
from observer.types import TrackState

from ..moving_points import SIGMA, every, motion
from ..solid_worlds import Solid, outline_of, person

MakeTrack = Callable[..., BodyTrack]
P = ObstacleParameters()
REACH_M = 0.15


def test_a_group_has_the_mean_motion_of_its_points() -> None:
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
    # The points share errors: the mean is less certain than with independent ones.
    stated = np.diag(group.velocity_cov)
    assert (stated > 1.5 * np.var(draws, axis=0)).all()
    assert (stated < SIGMA**2).all()


def test_more_certain_points_have_more_weight() -> None:
    places = np.array([[0.1 * k, 0, 3] for k in range(4)], float)
    velocity = np.array([[0.4, 0, 0]] + [[0.1, 0, 0]] * 3)
    seen = motion(places, velocity)
    seen.own_information[0] *= 100
    group = group_of(every(seen), seen, P)
    assert group is not None
    assert group.velocity[0] == pytest.approx((100 * 0.4 + 3 * 0.1) / 103)


def test_outliers_are_excluded_from_a_group() -> None:
    rng = np.random.default_rng(2)
    places = np.array([0.2, 0, 3]) + rng.normal(0, 0.05, (12, 3))
    places[[3, 7]] += [[1.5, 0, 0], [0, 0, 2.0]]
    seen = motion(places, np.array([0.3, 0, 0]))
    group = group_of(every(seen), seen, P)
    assert group is not None
    assert not {3, 7} & set(group.members.tolist())
    assert len(group.members) >= 8


def test_too_few_points_form_no_group() -> None:
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


def test_a_group_belongs_to_the_nearest_body_with_the_same_motion(make_track: MakeTrack) -> None:
    near, far = make_track((0, 0, 3), number=1), make_track((0.5, 0, 3), number=2)
    other = make_track((0.05, 0, 3), (-0.3, 0, 0), number=3)
    tracks = [far, near, other]
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), tracks) is near
    assert body_of(grouped((0.45, 0, 3), (0.3, 0, 0)), tracks) is far
    assert body_of(grouped((0.1, 0, 3), (-0.3, 0, 0)), tracks) is other
    assert body_of(grouped((0.1, 0, 3), (-0.3, 0, 0)), [near, far]) is None
    assert body_of(grouped((2.0, 0, 3), (0.3, 0, 0)), tracks) is None
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), []) is None


def test_points_much_faster_than_their_body_do_not_go_with_it(
    make_track: MakeTrack,
) -> None:
    """Points on a swinging limb, or sliding off its edge, are faster."""
    for sigma, speed, goes in ((0.03, 0.95, True), (0.03, 1.8, False), (0.5, 1.8, True)):
        track = make_track((0, 0, 3), (0.9, 0, 0), sigma=sigma)
        assert goes_with(track, grouped((0.1, 0, 3), (speed, 0, 0))) is goes


def test_a_body_with_an_uncertain_position_is_searched_farther_away(make_track: MakeTrack) -> None:
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


def test_resting_points_do_not_belong_to_a_body_however_uncertain(
    make_track: MakeTrack,
) -> None:
    """After a second out of sight, a body's place and velocity are nearly unknown."""
    vague = make_track(velocity=(0.4, 0, 0))
    vague.filter.covariances[:, :3, :3] = np.eye(3) * 0.3**2
    vague.filter.covariances[:, 3:6, 3:6] = np.eye(3) * 0.12**2
    assert body_of(grouped((0.1, 0, 3), (0.3, 0, 0)), [vague]) is vague
    assert body_of(grouped((0.1, 0, 3), (0.0, 0, 0)), [vague]) is None
    resting_one = make_track((0.1, 0, 3), (0.0, 0, 0), number=2)
    assert not are_one(vague, resting_one, REACH_M, P)
    assert are_one(vague, make_track((0.1, 0, 3), (0.35, 0, 0), number=2), REACH_M, P)


def test_a_foot_stepping_below_a_trunk_belongs_to_it(make_track: MakeTrack) -> None:
    """A foot at 1.9 m/s below a person walking at 0.6 m/s, but no other object or known track."""
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


def test_two_tracks_at_one_place_with_the_same_motion_are_one(make_track: MakeTrack) -> None:
    older = make_track()
    assert are_one(older, make_track((0.15, 0, 3.1), number=2), REACH_M, P)
    assert not are_one(older, make_track((0.15, 0, 3.1), (-0.3, 0, 0), number=2), REACH_M, P)
    assert not are_one(older, make_track((0.15, 0, 3.1), (0, 0, 0.4), number=2), REACH_M, P)


def test_tracks_driving_side_by_side_stay_separate(make_track: MakeTrack) -> None:
    assert not are_one(make_track(), make_track((0, 0, 4.5), number=2), REACH_M, P)
    assert not are_one(make_track(), make_track((1.2, 0, 3), number=2), REACH_M, P)


@pytest.mark.parametrize(("apart_m", "seen", "same"), [(1.1, True, False), (1.1, False, True),
                                                       (0.5, True, True)])  # fmt: skip
def test_two_people_side_by_side_stay_separate_while_both_are_seen(
    make_track: MakeTrack, apart_m: float, seen: bool, same: bool
) -> None:
    """Both rest, and are so tall that each lies within the space the other may occupy."""
    boxes = [Box(np.zeros(3), np.array([0.5, 1.8, 0.3]), 0.0) for _ in range(2)]
    older = make_track(velocity=(0, 0, 0), box=boxes[0])
    other = make_track((apart_m, 0, 3.0), (0, 0, 0), number=2, box=boxes[1])
    for track, x in ((older, 0.0), (other, apart_m)):
        track.outline = outline_of(person(x, 3.0))
        track.outline.seen = seen
    assert are_one(older, other, REACH_M, P) is same


@pytest.mark.parametrize(("behind_m", "same"), [(0.3, True), (0.55, False)])
def test_a_person_walking_behind_another_stays_separate(
    make_track: MakeTrack, behind_m: float, same: bool
) -> None:
    """Half hidden, and not known to move yet: a limb would not be that far behind, and as high."""
    boxes = [Box(np.zeros(3), np.array([0.9, 1.6, 0.3]), 0.0) for _ in range(2)]
    one = make_track(velocity=(0.9, 0, 0), box=boxes[0])
    other = make_track((0.25, 0, 3.0 + behind_m), (0, 0, 0), number=2, box=boxes[1], sigma=1.0)
    one.outline = outline_of(person(0.0, 3.0))
    other.outline = outline_of(person(0.25, 3.0 + behind_m))
    one.state = TrackState.CONFIRMED
    assert are_one(one, other, REACH_M, P) is same
    # What hangs there, such as a bag, is none.
    other.outline = outline_of(Solid((0.25, -0.2, 3.0 + behind_m), (0.3, 0.4, 0.2)))
    assert are_one(one, other, REACH_M, P)


@pytest.mark.parametrize(
    ("evidence", "place", "same"),
    [
        (STATIC, (0.7, 0.3, 2.6), False),
        (ARRIVED, (0.7, 0.3, 2.6), True),
        # On it: changing light and edges move points a little.
        (STATIC, (0.1, 0.0, 3.0), True),
    ],
)
def test_points_passing_something_at_rest_stay_separate(
    make_track: MakeTrack, evidence: int, place: tuple[float, float, float], same: bool
) -> None:
    """A robot beside part of a wall, which is not reported, and whose velocity is uncertain."""
    wall = make_track(
        velocity=(0, 0, 0), box=Box(np.zeros(3), np.array([0.45, 1.6, 0.3]), 0.0), sigma=1.0
    )
    wall.outline = outline_of(person(0.0, 3.0), evidence)
    passing = make_track(place, (0, 0, -0.6), number=2)
    assert are_one(wall, passing, 0.5, P) is same


@pytest.mark.parametrize(("apart_m", "same"), [(1.1, False), (0.5, True)])
def test_a_track_out_of_sight_does_not_take_the_number_of_a_reported_one(
    make_track: MakeTrack, apart_m: float, same: bool
) -> None:
    """However uncertain the hidden one's motion is by now."""
    boxes = [Box(np.zeros(3), np.array([0.5, 1.8, 0.3]), 0.0) for _ in range(2)]
    hidden = make_track(velocity=(0, 0, 0), box=boxes[0], sigma=0.5)
    other = make_track((apart_m, 0, 3.0), (0.3, 0, 0), number=2, box=boxes[1])
    for track, seen in ((hidden, False), (other, True)):
        track.outline = SimpleNamespace(seen=seen)  # type: ignore[assignment]
    hidden.state = TrackState.COASTING
    # One that is not reported yet may be the hidden one.
    assert are_one(hidden, other, REACH_M, P)
    other.state = TrackState.CONFIRMED
    assert are_one(hidden, other, REACH_M, P) is same


@pytest.mark.parametrize(("age_s", "same"), [(0.5, True), (1.5, False)])
def test_two_long_known_tracks_stay_separate(
    make_track: MakeTrack, age_s: float, same: bool
) -> None:
    """A cart and the person pushing it move alike, side by side."""
    cart = make_track(box=Box(np.zeros(3), np.array([1.1, 0.6, 0.6]), 0.0))
    pusher = make_track(
        (0.6, -0.2, 3.0), number=2, box=Box(np.zeros(3), np.array([0.5, 1.6, 0.3]), 0.0)
    )
    for track, x in ((cart, 0.0), (pusher, 0.6)):
        track.outline = outline_of(person(x, 3.0))
        track.state, track.age_s = TrackState.CONFIRMED, age_s
    assert are_one(cart, pusher, REACH_M, P) is same


def parts(make_track: MakeTrack, apart_m: float, other_mps: float) -> tuple[BodyTrack, BodyTrack]:
    """A trunk and what may be its legs, both reported and known for a while."""
    trunk = make_track(
        (0.0, -0.3, 3.0), (0.0, 0, -0.9), box=Box(np.zeros(3), np.array([0.5, 0.9, 0.3]), 0.0)
    )
    legs = make_track(
        (apart_m, 0.4, 3.0),
        (other_mps, 0, -0.9),
        number=2,
        box=Box(np.zeros(3), np.array([0.4, 0.9, 0.3]), 0.0),
        sigma=0.15,
    )
    for track in (trunk, legs):
        track.outline = SimpleNamespace(seen=True)  # type: ignore[assignment]
        track.state, track.age_s, track.rigid = TrackState.CONFIRMED, 1.5, False
    return trunk, legs


def test_a_person_seen_again_in_two_parts_is_one(make_track: MakeTrack) -> None:
    """After another passed in front; two people cannot be so near to each other."""
    assert are_one(*parts(make_track, 0.1, 0.1), REACH_M, P)
    assert not are_one(*parts(make_track, 0.5, 0.1), REACH_M, P), "somebody beside"
    assert not are_one(*parts(make_track, 0.1, 0.7), REACH_M, P), "somebody who crosses"


def test_a_part_that_is_out_of_sight_or_no_persons_stays_a_track(make_track: MakeTrack) -> None:
    trunk, legs = parts(make_track, 0.1, 0.1)
    assert legs.outline is not None
    legs.outline.seen = False
    assert not are_one(trunk, legs, REACH_M, P)
    for rigid in ((False, True), (True, False)):
        person, robot = parts(make_track, 0.1, 0.1)
        person.rigid, robot.rigid = rigid
        assert not are_one(person, robot, REACH_M, P), "a robot at somebody's feet"


def test_the_base_and_the_top_of_a_robot_with_a_mast_are_one(make_track: MakeTrack) -> None:
    """Nothing is tracked on the mast between them."""
    base, top = parts(make_track, 0.1, 0.0)
    base.rigid = top.rigid = True
    assert are_one(base, top, REACH_M, P)
    beside, robot = parts(make_track, 0.5, 0.0)
    beside.rigid = robot.rigid = True
    assert not are_one(beside, robot, REACH_M, P)


def test_the_end_of_a_turning_body_may_move_in_the_opposite_direction(
    make_track: MakeTrack,
) -> None:
    box = Box(np.zeros(3), np.array([1.0, 0.3, 1.2]), 0.0)
    turning = make_track(velocity=(0.6, 0, 0), yaw_rate=1.2, box=box)
    at = np.array([0, 0, 2.0])
    end = make_track(tuple(at), tuple(turning.velocity_at(at)), number=2)
    assert end.mean[3] == pytest.approx(-0.6)
    assert are_one(turning, end, REACH_M, P)
    assert not are_one(make_track(velocity=(0.6, 0, 0), box=box), end, REACH_M, P)


def test_a_track_without_a_box_is_not_merged(make_track: MakeTrack) -> None:
    older, younger = make_track(), make_track(number=2)
    younger.box = None
    assert not are_one(older, younger, REACH_M, P)
    assert not are_one(younger, older, REACH_M, P)
