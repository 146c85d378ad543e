"""The vehicle: ramps, contact, imperfect wheel odometry, sonar; checked by geometry."""

from __future__ import annotations

import math

import pytest

from observer.robots.models import SonarPose, robot_spec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.chassis import Drive
from observer.simulation.robots.floor import Outline, Surroundings
from observer.simulation.robots.sonar import sonar_range
from observer.simulation.robots.vehicle import Vehicle

START = PlanarState(0.0, 0.0, 0.0)
EMPTY = Surroundings()
P3DX = robot_spec("p3dx-sh")


def asked(speed: float = 0.0, turn_rate: float = 0.0) -> Drive:
    return Drive(speed, turn_rate, 0.5, 0.5, 2.0, 2.0, powered=True)


def vehicle(drive: Drive, state: PlanarState = START, seed: int | None = None) -> Vehicle:
    made = Vehicle(P3DX, (0.5, 0.4), state, bumpers=5, seed=seed)
    made.drive = drive
    return made


def test_it_follows_its_ramp_with_inertia_up_to_its_speed() -> None:
    one = vehicle(asked(0.5))
    seen = []
    for _ in range(200):
        one.advance(0.01, EMPTY)
        seen.append(one.state.vx)
    assert seen == sorted(seen)
    # Half a second into a ramp of 0.5 m/s^2, less what a lag of 0.08 s holds back.
    assert seen[49] == pytest.approx(0.25 - 0.5 * 0.08, abs=0.01)
    assert seen[-1] == pytest.approx(0.5, abs=1e-3)
    # The distance of the ramp, less that of the lag.
    assert one.state.x == pytest.approx(0.5 - 0.5 * 0.08 + 0.5 * 1.0 - 0.25, abs=0.02)


def test_a_full_circle_returns_pose_and_odometry_to_the_start() -> None:
    one = vehicle(asked(0.3, 0.5))
    one.advance(10, EMPTY)
    before = one.state, one.wheels()
    one.advance(2 * math.pi / 0.5, EMPTY)
    after = one.state, one.wheels()
    assert (after[0].x, after[0].y) == pytest.approx((before[0].x, before[0].y), abs=1e-3)
    assert after[0].heading - before[0].heading == pytest.approx(2 * math.pi, abs=1e-3)
    assert (after[1].x, after[1].y) == pytest.approx((after[0].x, after[0].y), abs=1e-9)
    left, right = (getattr(after[1], n) - getattr(before[1], n) for n in ("left_m", "right_m"))
    # With the half track width that the model's own factor implies.
    assert right - left == pytest.approx(2 * 2 * math.pi / (1000 * P3DX.wheel_turn), abs=1e-3)


def test_reversing_brakes_first_and_without_power_it_coasts_to_rest() -> None:
    one = vehicle(asked(0.4))
    one.advance(3, EMPTY)
    one.drive = asked(-0.4)
    speeds = []
    for _ in range(250):
        one.advance(0.01, EMPTY)
        speeds.append(one.state.vx)
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(-0.4, abs=2e-3)
    one.drive = Drive(0.4, powered=False)
    one.advance(1.5, EMPTY)
    assert one.state.vx == 0.0


def test_states_are_repeatable_and_odometry_errors_depend_on_the_seed() -> None:
    def driven(seed: int | None) -> Vehicle:
        one = vehicle(asked(0.3, 0.2), seed=seed)
        for _ in range(100):
            one.advance(0.067, EMPTY)
        return one

    first, again, other, exact = driven(4), driven(4), driven(5), driven(None)
    assert first.wheels() == again.wheels()
    assert first.state == again.state == other.state == exact.state
    assert first.wheels() != other.wheels()
    errors = []
    for seed in range(30):
        one = driven(seed).wheels()
        errors.append((one.left_m + one.right_m) / (exact.wheels().left_m * 2) - 1)
        assert one.x != exact.wheels().x
    assert 0.001 < max(map(abs, errors)) < 0.2


@pytest.mark.parametrize(
    "around",
    [
        Surroundings((-2.0, 1.0, -2.0, 2.0)),
        Surroundings(outlines=(Outline.of_box(1.5, 0.1, 0.0, 1.0, 0.5),)),
        Surroundings(outlines=(Outline.of_box(1.0 + math.sqrt(0.5), 0.0, math.pi / 4, 1, 1),)),
    ],
)
def test_it_stops_at_an_obstacle_and_stalls_while_it_pushes(around: Surroundings) -> None:
    one = vehicle(asked(0.5))
    one.advance(4, around)
    assert one.state.x == pytest.approx(1.0 - 0.25, abs=0.006)
    assert one.state.vx == 0.0
    wheels = one.wheels()
    assert wheels.stalled == (True, True)
    assert (wheels.front_bumpers, wheels.rear_bumpers) == (31, 0)
    # Blocked wheels do not count.
    assert wheels.x == pytest.approx(one.state.x, abs=1e-9)
    one.drive = asked()
    one.advance(0.1, around)
    assert one.wheels().stalled == (False, False)
    assert one.wheels().front_bumpers == 31
    one.drive = asked(-0.5)
    one.advance(1, around)
    assert one.state.x < 0.6
    assert one.wheels().stalled == (False, False)
    assert one.wheels().front_bumpers == 0


def test_an_overlapping_obstacle_can_be_left_but_not_entered_further() -> None:
    over = Surroundings(outlines=(Outline.of_box(0.4, 0.0, 0.0, 0.5, 0.5),))
    one = vehicle(asked(0.3))
    one.advance(1, over)
    assert one.state.x == 0.0
    one.drive = asked(-0.3)
    one.advance(2, over)
    assert one.state.x < -0.3


def test_the_overlap_depth_is_the_shortest_distance_out() -> None:
    one = Outline.of_box(0, 0, 0, 2, 1)
    assert one.depth(Outline.of_box(1.9, 0, 0, 2, 1)) == pytest.approx(0.1)
    assert one.depth(Outline.of_box(0.5, 0.8, 0, 2, 1)) == pytest.approx(0.2)
    assert one.depth(Outline.of_box(2.1, 0, 0, 2, 1)) == 0
    # Corner to corner: their axis-aligned boxes overlap, but they do not.
    assert one.depth(Outline.of_box(1.6, 1.1, math.pi / 4, 1, 1)) == 0


ROOM = (-2.0, 4.0, -3.0, 3.0)


@pytest.mark.parametrize(
    ("around", "pose", "expected"),
    [
        (Surroundings(ROOM), SonarPose(0.1, 0, 0), 3.9),
        (Surroundings(ROOM), SonarPose(0, 0.1, math.pi / 2), 2.9),
        (Surroundings((-9, 9, -9, 9)), SonarPose(0, 0, 0), None),
        (EMPTY, SonarPose(0, 0, 0), None),
        # The wall's normal is 20 degrees off, of which the cone covers 15.
        (
            Surroundings(ROOM),
            SonarPose(0, 0, math.radians(20)),
            4 / math.cos(math.radians(5)),
        ),
        # A post thinner than the spacing of any rays.
        (Surroundings(outlines=(Outline.of_box(3, 0.41, 0, 0.01, 0.01),)), SonarPose(0, 0, 0),
         math.hypot(2.995, 0.405)),
        # Just outside the cone: 15 degrees at 3 m are 0.80 m.
        (Surroundings(outlines=(Outline.of_box(3, 0.85, 0, 0.02, 0.02),)), SonarPose(0, 0, 0),
         None),
        # Across the whole cone with both ends outside, in front of a wall.
        (Surroundings(ROOM, (Outline.of_box(1.5, 0, 0, 0.2, 4),)), SonarPose(0, 0, 0), 1.4),
        # Nothing behind the sonar counts.
        (Surroundings(outlines=(Outline.of_box(-1, 0, 0, 0.2, 4),)), SonarPose(0, 0, 0), None),
        # Nearer than its minimum range.
        (Surroundings(outlines=(Outline.of_box(0.52, 0, 0, 1, 1),)), SonarPose(0, 0, 0), 0.05),
    ],
)  # fmt: skip
def test_sonar_finds_the_nearest_surface_in_its_cone(
    around: Surroundings, pose: SonarPose, expected: float | None
) -> None:
    found = sonar_range(around.edges(), START, pose)
    assert found == (None if expected is None else pytest.approx(expected, abs=1e-6))


def test_sonar_moves_and_turns_with_its_vehicle() -> None:
    state = PlanarState(1.0, -1.0, math.pi / 2)
    around = Surroundings((-2.0, 4.0, -3.0, 3.0)).edges()
    assert sonar_range(around, state, SonarPose(0.2, 0.1, 0)) == pytest.approx(3.8)
    assert sonar_range(around, state, SonarPose(0.2, 0.1, math.pi / 2)) == pytest.approx(2.9)
