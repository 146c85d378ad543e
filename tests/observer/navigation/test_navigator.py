"""Plans of a robot among people and walls: what it does, and the reason it gives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.navigation.errand import Errand, Goal
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import NavigationParameters
from observer.navigation.plan import Plan
from observer.occupancy import BLOCKED
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.types import Status

LIMITS, PLANNER = GuardParameters(), NavigationParameters()
BEARINGS = tuple(np.radians(np.arange(-30.0, 30.1, 3.0)).tolist())
FREE = FreeScan(BEARINGS, (None,) * 21, (0.3,) * 21, (5.0,) * 21)
SPEC = robot_spec("p3dx-sh")
QUIET = tuple(
    SonarReading(k, one.x, one.y, one.heading, None, 9.95) for k, one in enumerate(SPEC.sonars)
)
ERRAND = Errand(
    Goal(1, 5.0, 0.0, 1e-3), 10.0, 0.0, 0.0, 0.0, 0.3, 0.0,
    SPEC.radius_m, SPEC.width_m, SPEC.length_m, QUIET,
)  # fmt: skip


def person(x: float, y: float, vx: float = 0.0, vy: float = 0.0, number: int = 3) -> SeenObstacle:
    return SeenObstacle(number, x, y, vx, vy, 0.3, 0.05, 0.1, False)


def sight(
    *people: SeenObstacle, time: float = 10.0, scan: FreeScan = FREE, **more: object
) -> Sight:
    made = Sight(1, time, time + 0.02, "real", Status.OK, (), True, people, scan)
    return replace(made, **more)  # type: ignore[arg-type]


def plan(*people: SeenObstacle, errand: Errand = ERRAND, **more: object) -> Plan:
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(*people, **more), np.array([errand.x, errand.y, errand.yaw]))  # type: ignore[arg-type]
    return navigator.plan(errand, 10.05)


def test_a_free_path_is_driven_straight_and_fast() -> None:
    made = plan()
    assert made.speed_mps == pytest.approx(LIMITS.speed_max_mps)
    assert made.turn_rate_radps == pytest.approx(0.0, abs=0.05)
    assert made.path[-1][0] > 1.5
    assert made.reason == "Driving to the goal, 5.0 m away."
    assert made.waits_for is None
    assert made.risk_per_metre == 0.0


def test_the_robot_turns_towards_a_goal_behind_it() -> None:
    made = plan(errand=replace(ERRAND, goal=Goal(1, -3.0, 0.5, 1e-3), speed_mps=0.0))
    assert made.speed_mps == pytest.approx(0.0, abs=0.02)
    assert made.turn_rate_radps > 0.5
    assert made.reason == "Turning towards the goal."


def test_the_robot_stops_at_the_goal() -> None:
    made = plan(errand=replace(ERRAND, x=4.9))
    assert (made.speed_mps, made.turn_rate_radps, made.path) == (0.0, 0.0, ())
    assert made.reason == "The goal is reached."


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_person_crossing_close_by_has_right_of_way(side: float) -> None:
    made = plan(person(1.0, 1.0 * side, 0.0, -1.2 * side))
    straight = made.speed_mps > 0.4 and abs(made.turn_rate_radps) < 0.1
    assert not straight
    assert made.waits_for == 3
    assert "obstacle 3" in made.reason
    assert made.meets_s is not None
    assert 0 < made.meets_s < 3


def test_a_person_walking_away_does_not_affect_the_plan() -> None:
    made = plan(person(2.5, 1.5, 0.0, 1.3))
    assert made.speed_mps == pytest.approx(LIMITS.speed_max_mps)
    assert made.waits_for is None


def test_the_plan_stays_within_the_permitted_risk() -> None:
    crossing = person(1.6, 1.5, 0.0, -1.2)
    plans = [
        plan(crossing, errand=replace(ERRAND, goal=replace(ERRAND.goal, risk_per_metre=risk)))
        for risk in (1e-5, 1e-3, 1e-1, 1.0)
    ]
    for made, risk in zip(plans, (1e-5, 1e-3, 1e-1, 1.0), strict=True):
        assert made.risk_per_metre <= risk


def test_the_robot_drives_around_a_person_standing_in_its_path() -> None:
    made = plan(person(1.9, 0.0))
    assert abs(made.turn_rate_radps) > 0.1
    assert made.path
    gaps = [math.dist(place, (1.9, 0.0)) for place in made.path]
    assert min(gaps) > 0.3 + 0.26
    assert made.reason == "Driving around obstacle 3."


def test_a_person_who_left_the_view_is_avoided_for_a_while() -> None:
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(person(0.9, 0.5, 0.0, -0.4)), np.zeros(3))
    navigator.see(sight(time=10.1), np.zeros(3))
    assert navigator.plan(ERRAND, 10.15).waits_for == 3
    later = replace(ERRAND, time=13.0)
    navigator.see(sight(time=13.0), np.zeros(3))
    assert navigator.plan(later, 13.05).waits_for is None


def test_an_unconfirmed_person_out_of_view_is_kept_beside_another_one() -> None:
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(person(0.9, 0.5, 0.0, -0.4, number=-2)), np.zeros(3))
    navigator.see(sight(person(4.0, -2.0, number=-3), time=10.1), np.zeros(3))
    assert navigator.plan(ERRAND, 10.15).waits_for == -2


def test_a_confirmed_person_replaces_the_unconfirmed_one() -> None:
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(person(1.5, 1.2, 0.0, -1.2, number=-2)), np.zeros(3))
    assert navigator.plan(ERRAND, 10.05).waits_for == -2
    navigator.see(sight(person(1.5, 1.2, 0.0, 1.3, number=7), time=10.1), np.zeros(3))
    assert navigator.plan(ERRAND, 10.15).waits_for is None


def test_the_robot_drives_around_a_box_in_its_path() -> None:
    blocked = tuple(2.0 if abs(each) < 0.15 else None for each in BEARINGS)
    scan = FreeScan(
        BEARINGS, blocked, (0.3,) * 21, tuple(5.0 if far is None else far for far in blocked)
    )
    navigator = Navigator(LIMITS, PLANNER)
    for k in range(-7, 1):
        navigator.see(sight(time=10.0 + 0.1 * k, scan=scan), np.zeros(3))
    made = navigator.plan(ERRAND, 10.05)
    assert made.path
    gaps = [math.hypot(x - 2.0, max(abs(y) - 0.3, 0.0)) for x, y in made.path]
    assert min(gaps) > 0.26


def test_the_planner_respects_the_guard_and_reports_its_reason() -> None:
    """It does not drive over unseen ground, and reports the guard's reason."""
    unseen = FreeScan(BEARINGS, (None,) * 21, (1.0,) * 21, (1.0,) * 21)
    made = plan(scan=unseen, errand=replace(ERRAND, speed_mps=0.0, sonars=()))
    assert made.speed_mps == 0.0
    assert made.reason == (
        "Waiting: the ground ahead is not known to be free: neither visible nor covered by sonar."
    )


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"status": Status.LOST, "reasons": ("it is too dark",)}, "vision is lost: it is too dark"),
        ({"status": Status.DEGRADED}, "vision is degraded"),
        ({"received": 9.5}, "a camera frame"),
    ],
)
def test_the_robot_waits_with_a_reason_without_sight(more: dict[str, object], reason: str) -> None:
    made = plan(**more)  # type: ignore[arg-type]
    assert (made.speed_mps, made.turn_rate_radps, made.path) == (0.0, 0.0, ())
    assert reason in made.reason


def test_people_are_remembered_after_a_goal_change() -> None:
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(person(0.9, 0.5, 0.0, -0.4)), np.zeros(3))
    navigator.plan(ERRAND, 10.05)
    navigator.see(sight(time=10.1), np.zeros(3))
    other = replace(ERRAND, goal=Goal(2, 4.0, 0.2, 1e-3))
    made = navigator.plan(other, 10.15)
    assert (made.goal, made.waits_for) == (2, 3)


_NUMBER = st.floats(-50.0, 50.0)


@settings(max_examples=40)
@given(st.lists(st.tuples(_NUMBER, _NUMBER, _NUMBER, _NUMBER), max_size=4), _NUMBER, _NUMBER)
def test_the_plan_stays_within_the_limits_for_any_people(
    people: list[tuple[float, float, float, float]], x: float, y: float
) -> None:
    seen = [person(*values, number=k) for k, values in enumerate(people)]
    made = plan(*seen, errand=replace(ERRAND, goal=Goal(1, x, y, 1e-3)))
    assert 0.0 <= made.speed_mps <= LIMITS.speed_max_mps + 1e-9
    assert abs(made.turn_rate_radps) <= LIMITS.turn_rate_max_radps + 1e-9
    assert made.reason.endswith(".")
    assert np.isfinite(np.array(made.path)).all()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
def test_impossible_values_stop_the_robot(value: float) -> None:
    errands = [
        *(replace(ERRAND, **{name: value}) for name in ("x", "y", "yaw", "speed_mps")),  # type: ignore[arg-type]
        replace(ERRAND, turn_rate_radps=value),
        replace(ERRAND, goal=replace(ERRAND.goal, x=value)),
    ]
    for errand in errands:
        navigator = Navigator(LIMITS, PLANNER)
        navigator.see(sight(person(2.0, 0.0)), np.zeros(3))
        made = navigator.plan(errand, 10.05)
        assert (made.speed_mps, made.turn_rate_radps, made.path) == (0.0, 0.0, ())
        assert made.reason == "Waiting: the robot reports impossible values."
    track = person(2.0, 0.0)
    tracks = [replace(track, **{name: value}) for name in ("x", "y", "vx", "vy", "radius_m")]  # type: ignore[arg-type]
    for one, pose in [*((each, 0.0) for each in tracks), (track, value)]:
        navigator = Navigator(LIMITS, PLANNER)
        navigator.see(sight(one), np.array([0.0, 0.0, pose]))
        made = navigator.plan(ERRAND, 10.05)
        assert (made.speed_mps, made.path) == (0.0, ())
        assert made.reason == "Waiting: the camera frame contains impossible values."


def test_exactly_known_obstacles_are_planned_around() -> None:
    """Without any uncertainty, distances are divided by a standard deviation of zero."""
    exact = replace(person(1.9, 0.0), position_sigma_m=0.0, velocity_sigma_mps=0.0)
    navigator = Navigator(LIMITS, NavigationParameters(acceleration_noise=0.0))
    navigator.see(sight(exact), np.zeros(3))
    made = navigator.plan(ERRAND, 10.0)
    assert abs(made.turn_rate_radps) > 0.1
    assert math.isfinite(made.risk_per_metre)


def test_an_unseen_person_is_forgotten_when_sonar_has_no_echo() -> None:
    navigator = Navigator(LIMITS, PLANNER)
    # Sonar would hear the person at the predicted place.
    navigator.see(sight(person(1.2, 0.0, -0.1)), np.zeros(3))
    navigator.see(sight(time=10.5), np.zeros(3))
    quiet = tuple(replace(one, received=10.45) for one in QUIET)
    heard = tuple(replace(one, range_m=0.7) for one in quiet)
    there = navigator.plan(replace(ERRAND, time=10.5, sonars=heard), 10.5)
    assert there.waits_for == 3
    gone = navigator.plan(replace(ERRAND, time=10.5, sonars=quiet), 10.5)
    assert gone.waits_for is None


def test_an_echo_is_where_the_sonar_pointed_when_it_was_read() -> None:
    """A turning robot hears a post at 45° to its left, in readings that are up to 0.3 s old."""
    navigator = Navigator(LIMITS, PLANNER)
    for k in range(14):
        time = 10.0 + 0.1 * k
        read = time - 0.1 * (k % 3)
        yaw, then = 1.0 * (time - 10.0), 1.0 * (read - 10.0)
        heading = math.remainder(math.radians(45.0) - then, 2 * math.pi)
        sonar = SonarReading(0, 0.0, 0.0, heading, 1.0, read)
        # No floor is seen, which would show the post's place to be free.
        navigator.see(replace(sight(time=time), scan=None), np.array([0.0, 0.0, yaw]))
        errand = replace(
            ERRAND, time=time, yaw=yaw, speed_mps=0.0, turn_rate_radps=1.0, sonars=(sonar,)
        )
        navigator.plan(errand, time)
    made = navigator.local_map()
    assert made is not None
    places = np.argwhere(made.cells() == BLOCKED) * made.cell_m + (made.x, made.y)
    assert len(places)
    off = np.hypot(*(places + made.cell_m / 2 - 1.0 / math.sqrt(2)).T)
    assert off.max() < 1.5 * made.cell_m


def test_a_robot_boxed_in_by_standing_obstacles_does_not_say_that_they_move() -> None:
    around = [
        person(1.0 * math.cos(angle), 1.0 * math.sin(angle), number=k + 1)
        for k, angle in enumerate(np.radians(np.arange(-100, 101, 25)).tolist())
    ]
    made = plan(*around, errand=replace(ERRAND, speed_mps=0.0))
    assert made.speed_mps == 0.0
    assert made.waits_for is not None
    assert made.reason == f"Waiting: obstacle {made.waits_for} is in the way."


def counts_after_a_quiet_sonar(
    known: SeenObstacle, age_s: float, turn_rate_radps: float = 0.0
) -> bool:
    """Return whether a person who was seen last at 10.0 still counts after one quiet reading.

    Args:
        age_s: of the reading, by a sonar that looks ahead, at the plan 0.72 s later.
        turn_rate_radps: of the robot since then; its yaw is 0 at the plan.
    """
    navigator = Navigator(LIMITS, PLANNER)
    start = -0.7 * turn_rate_radps
    navigator.see(sight(known), np.array([0.0, 0.0, start]))
    for k in range(8):
        time = 10.02 + 0.1 * k
        yaw = start + 0.1 * k * turn_rate_radps
        errand = replace(
            ERRAND, time=time, yaw=yaw, speed_mps=0.0, turn_rate_radps=turn_rate_radps, sonars=()
        )
        if k:
            navigator.see(sight(time=time - 0.02), np.array([0.0, 0.0, yaw]))
        if k == 7:
            sonar = SonarReading(0, 0.2, 0.0, 0.0, None, time - age_s)
            errand = replace(errand, sonars=(sonar,))
        made = navigator.plan(errand, time)
    return 3 in (made.waits_for, *(path.track for path in made.refused))


def test_a_quiet_reading_counts_for_where_the_person_was_then() -> None:
    # Comes from the side, and is 13° off the sonar's axis now but was 21° off 0.3 s ago.
    comes = person(1.42, 0.62, -0.6, -0.6)
    assert counts_after_a_quiet_sonar(comes, age_s=0.3)
    assert not counts_after_a_quiet_sonar(comes, age_s=0.0)


def test_a_quiet_reading_counts_only_if_the_person_was_out_of_view_by_then() -> None:
    stands = person(1.2, 0.0)
    assert counts_after_a_quiet_sonar(stands, age_s=0.4)
    assert not counts_after_a_quiet_sonar(stands, age_s=0.3)


def test_a_quiet_reading_counts_only_if_the_person_would_probably_have_echoed() -> None:
    """Whose velocity is hardly known may be beside the cone that covers the predicted place."""
    stands = person(1.2, 0.0)
    assert not counts_after_a_quiet_sonar(stands, age_s=0.0)
    assert counts_after_a_quiet_sonar(replace(stands, velocity_sigma_mps=0.5), age_s=0.0)


def test_a_quiet_reading_counts_for_where_the_robot_looked_then() -> None:
    # 23° off the axis when the sonar was read; the robot has turned towards the person since.
    stands = person(1.2 * math.cos(0.7), 1.2 * math.sin(0.7))
    assert counts_after_a_quiet_sonar(stands, age_s=0.34, turn_rate_radps=1.0)
    assert not counts_after_a_quiet_sonar(stands, age_s=0.0, turn_rate_radps=1.0)


def test_a_person_out_of_view_is_predicted_without_habits_confirmed_by_the_prediction() -> None:
    alone = replace(ERRAND, sonars=())
    # Would pass, and meets the robot only on turning.
    passes = person(3.0, 3.0, -0.9, -0.6)
    navigator = Navigator(LIMITS, PLANNER)
    navigator.see(sight(passes), np.zeros(3))
    for k in range(21):
        time = 10.0 + 0.1 * k
        if k:
            navigator.see(sight(time=time), np.zeros(3))
        made = navigator.plan(replace(alone, time=time), time)
    # The same prediction, made at once from the sight of 2 s ago.
    new = Navigator(LIMITS, PLANNER)
    new.see(sight(passes), np.zeros(3))
    new.see(sight(time=12.0), np.zeros(3))
    expected = new.plan(replace(alone, time=12.0), 12.0)
    risks, expects = (
        [path.risk for path in each.refused if path.cause == "risk"] for each in (made, expected)
    )
    assert risks
    assert risks == pytest.approx(expects)
