"""Odometry from wheel angles."""

from __future__ import annotations

import math

import pytest

from observer.coppeliasim.pioneers import WheelOdometry

RADIUS, TRACK = 0.1, 0.4


def test_a_quarter_circle_in_one_reading_and_in_many() -> None:
    # About a point 1 m to the left: the left wheel is at a radius of 0.8 m, the right one at 1.2 m.
    left, right = (math.pi / 2 * r / RADIUS for r in (0.8, 1.2))
    for steps in (1, 7):
        odometry = WheelOdometry(RADIUS, TRACK)
        for k in range(steps + 1):
            place = odometry.add(5.0 + left * k / steps, right * k / steps)
        assert (place.x, place.y, place.yaw) == pytest.approx((1.0, 1.0, math.pi / 2))


def test_turning_in_place_and_going_back() -> None:
    odometry = WheelOdometry(RADIUS, TRACK)
    odometry.add(0.0, 0.0)
    turned = odometry.add(-math.pi * TRACK / 2 / RADIUS, math.pi * TRACK / 2 / RADIUS)
    assert (turned.x, turned.y, turned.yaw) == pytest.approx((0, 0, math.pi))
    back = odometry.add(*(a - 10.0 for a in (-math.pi * 2, math.pi * 2)))
    assert (back.x, back.y) == pytest.approx((1.0, 0.0))


def test_rebasing_after_a_joint_reset_adds_no_distance() -> None:
    odometry = WheelOdometry(RADIUS, TRACK)
    odometry.add(0.0, 0.0)
    place = odometry.add(10.0, 10.0)
    odometry.rebase()
    assert odometry.add(0.0, 0.0) == place
    assert odometry.add(1.0, 1.0).x == pytest.approx(1.1)
