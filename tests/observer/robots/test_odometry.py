"""Wheel odometry: counters that wrap, jumps, and a square of 10 m."""

from __future__ import annotations

import math
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.models import RobotSpec, robot_spec
from observer.robots.odometry import WheelOdometry

P3DX = robot_spec("p3dx-sh")
DT = 0.1


class Firmware:
    """Reports a true position as a robot does: in whole units, 15 bits, in its own axes.

    ``x``, ``y``, ``yaw``: true values, metres and radians, in the firmware's axes.
    """

    def __init__(self, spec: RobotSpec, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> None:
        self.spec, self.x, self.y, self.yaw = spec, x, y, yaw

    def told(self) -> tuple[int, int, int]:
        unit = self.spec.distance_mm / 1000
        turn = round(self.yaw / (math.tau / 4096))
        return (
            round(self.x / unit) & 0x7FFF,
            round(self.y / unit) & 0x7FFF,
            (turn + 2048) % 4096 - 2048,
        )

    def forward(self, metres: float) -> None:
        self.x += metres * math.cos(self.yaw)
        self.y += metres * math.sin(self.yaw)


@pytest.mark.parametrize("model", ["p3dx-sh", "p3dx", "amigo-sh", "amigo"])
@pytest.mark.parametrize("start", [(0.0, 0.0), (32.5, 0.2), (-0.001, 14.0)])
def test_a_10_m_square_closes_within_a_millimetre(model: str, start: tuple[float, float]) -> None:
    spec = robot_spec(model)
    robot, odometry, time = Firmware(spec, *start), WheelOdometry(spec), 0.0
    odometry.add(*robot.told(), time)
    worst = 0.0
    for _ in range(4):
        for _ in range(400):
            time += DT
            robot.forward(10 / 400)
            place = odometry.add(*robot.told(), time)
            truth = robot.x - start[0], robot.y - start[1]
            worst = max(worst, math.dist((place.x, place.y), truth))
        for _ in range(30):
            time += DT
            robot.yaw += math.pi / 2 / 30
            place = odometry.add(*robot.told(), time)
    assert odometry.jumps == 0
    sys.stdout.write(f"{model} from {start}: worst {worst * 1000:.3f} mm\n")
    # Rounding to whole units, at the start and now, in each of x and y.
    assert worst <= spec.distance_mm / 1000 * math.sqrt(2) + 1e-9
    assert math.hypot(place.x, place.y) <= 0.001
    assert place.yaw == pytest.approx(math.tau, abs=1e-9)


def test_ten_turns_add_up_to_their_angle() -> None:
    robot, odometry = Firmware(P3DX), WheelOdometry(P3DX)
    for tick in range(1001):
        robot.yaw = -tick * 20 * math.pi / 1000
        place = odometry.add(*robot.told(), tick * DT)
    assert place.yaw == pytest.approx(-20 * math.pi, abs=1e-3)


def test_the_axes_are_those_of_the_initial_pose() -> None:
    robot, odometry = Firmware(P3DX, 3.0, -2.0, math.pi / 2), WheelOdometry(P3DX)
    odometry.add(*robot.told(), 0.0)
    for tick in range(10):
        robot.forward(0.05)
        place = odometry.add(*robot.told(), (tick + 1) * DT)
    assert (place.x, place.y, place.yaw) == pytest.approx((0.5, 0.0, 0.0), abs=0.002)


def test_a_counter_reset_is_a_jump_and_adds_no_distance() -> None:
    robot, odometry = Firmware(P3DX, 5.0, 0.0, 1.0), WheelOdometry(P3DX)
    odometry.add(*robot.told(), 0.0)
    robot.forward(0.1)
    before = odometry.add(*robot.told(), 0.1)
    assert odometry.add(0, 0, 0, 0.2) == before
    assert odometry.jumps == 1
    # It continues from there, in our unchanged axes.
    after = odometry.add(100, 0, 0, 0.3)
    assert math.dist((after.x, after.y), (before.x, before.y)) == pytest.approx(0.1)
    assert after.y == pytest.approx(0.0, abs=0.001)


def test_a_counter_reset_near_the_wrap_is_a_jump() -> None:
    odometry = WheelOdometry(P3DX)
    odometry.add(0x7000, 0, 0, 0.0)
    assert odometry.add(0, 0, 0, 0.1).x == 0.0
    assert odometry.jumps == 1


def test_a_reset_of_the_heading_alone_is_a_jump() -> None:
    odometry = WheelOdometry(robot_spec("amigo-sh"))
    odometry.add(0, 0, 1900, 0.0)
    assert odometry.add(0, 0, 0, 0.1).yaw == 0.0
    assert odometry.jumps == 1


def test_odometry_continues_after_a_new_baseline() -> None:
    odometry = WheelOdometry(P3DX)
    odometry.add(0, 0, 0, 0.0)
    odometry.add(100, 0, 1024, 0.1)
    odometry.rebaseline()
    same = odometry.add(20000, 7, 0, 50.0)
    assert (same.x, same.y, same.yaw) == pytest.approx((0.1, 0.0, math.pi / 2))
    on = odometry.add(20100, 7, 0, 50.1)
    assert (on.x, on.y) == pytest.approx((0.1, 0.1))
    assert odometry.jumps == 0


def test_delayed_packets_that_arrive_together_are_no_jump() -> None:
    odometry = WheelOdometry(P3DX)
    for each in range(5):
        place = odometry.add(each * 220, 0, 0, 1.0 + each * 1e-4)
    assert odometry.jumps == 0
    assert place.x == pytest.approx(0.88)


@given(st.lists(st.tuples(st.integers(-200, 200), st.integers(-200, 200)), max_size=300))
def test_sums_are_exact_however_often_counters_wrap(steps: list[tuple[int, int]]) -> None:
    odometry, x, y = WheelOdometry(P3DX), 0, 0
    place = odometry.add(0, 0, 0, 0.0)
    for tick, (dx, dy) in enumerate(steps):
        x, y = x + dx, y + dy
        place = odometry.add(x & 0x7FFF, y & 0x7FFF, 0, (tick + 1) * DT)
    assert (place.x, place.y) == pytest.approx((x / 1000, y / 1000), abs=1e-9)
