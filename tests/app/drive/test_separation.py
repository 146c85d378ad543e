"""The distance left ahead of a stopped robot, from what is seen and from sonar echoes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from app.drive.separation import is_heard, separation
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.robots.contract import RobotPhase, RobotReport, SonarReading
from observer.types import Status

STOOD = 10.0
REPORT = RobotReport(RobotPhase.CONNECTED, length_m=0.4, width_m=0.4)
NOTHING = Sight(1, 0.0, 0.0, "real", Status.OK, (), True)
ASIDE = FreeScan((-1.0, 0.0, 1.0), (0.6, 1.2, 0.6), (0.0,) * 3, (0.6, 1.2, 0.6))


def left(sight: Sight | None, report: RobotReport | None, direction: float = 1.0) -> float | None:
    return separation(sight, report, STOOD, direction)


def sonar(degrees: float, range_m: float | None, received: float = STOOD + 0.1) -> SonarReading:
    heading = math.radians(degrees)
    x, y = 0.2 * math.cos(heading), 0.2 * math.sin(heading)
    return SonarReading(0, x, y, heading, range_m, received)


def test_separation_is_to_the_nearest_obstacle_or_surface_ahead() -> None:
    assert left(NOTHING, REPORT) is None
    assert left(NOTHING, None) is None
    walls = replace(NOTHING, scan=ASIDE)
    assert left(walls, REPORT) == pytest.approx(1.0)
    assert left(walls, REPORT, -1.0) is None
    person = SeenObstacle(1, 0.5, 0.9, 0.0, 0.0, 0.3, None, None, False)
    seen = replace(walls, obstacles=(person,))
    assert left(seen, REPORT) == pytest.approx((0.3**2 + 0.7**2) ** 0.5 - 0.3)


def test_echoes_ahead_of_the_robot_at_rest_count() -> None:
    walls = replace(NOTHING, scan=ASIDE)

    def heard(*sonars: SonarReading) -> RobotReport:
        return replace(REPORT, sonars=sonars)

    assert left(walls, heard(sonar(0, 0.3))) == pytest.approx(0.3)
    assert left(None, heard(sonar(0, 0.3))) == pytest.approx(0.3)
    # No echo gives no distance, a sonar at the side does not look ahead, and echoes heard while
    # the robot still rolled are stale.
    aside = (sonar(90, 0.3), sonar(41, 0.08), sonar(180, 0.3))
    for other in (*aside, sonar(0, None), sonar(0, 0.3, STOOD)):
        assert left(walls, heard(other)) == pytest.approx(1.0)
        assert left(None, heard(other)) is None
    assert left(walls, heard(sonar(180, 0.3)), -1.0) == pytest.approx(0.3)


def test_sonars_facing_the_path_are_awaited_while_they_report_echoes() -> None:
    def is_waited_for(*sonars: SonarReading) -> bool:
        return not is_heard(replace(REPORT, sonars=sonars), STOOD, 1.0)

    assert is_waited_for(sonar(10, 0.3), sonar(-10, 0.3, STOOD - 0.2))
    assert not is_waited_for(sonar(10, 0.3), sonar(-10, None))
    assert not is_waited_for(sonar(10, 0.3), sonar(-10, 0.3, STOOD - 3.0))
    assert not is_waited_for(sonar(10, 0.3), sonar(50, 0.3, STOOD - 0.2))
    assert not is_waited_for(sonar(10, 0.3), sonar(170, 0.3, STOOD - 0.2))
    assert not is_waited_for()
    assert is_heard(None, STOOD, 1.0)
