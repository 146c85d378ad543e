"""Ground that sonar shows to be clear."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.guard.dead_reckoning import DeadReckoning
from observer.guard.parameters import GuardParameters
from observer.guard.sonar_clear import clear_by_sonar, echo_at, fresh_sonar
from observer.robots.contract import SonarReading

P = GuardParameters(sonar_reach_m=2.0, sonar_half_angle_deg=15.0, thing_width_m=0.3)
NOW = 10.0


def standing() -> DeadReckoning:
    past = DeadReckoning()
    past.advance(NOW - 0.2, 0.0, 0.0)
    past.advance(NOW, 0.0, 0.0)
    return past


def ahead(range_m: float | None, received: float = NOW, heading: float = 0.0) -> SonarReading:
    return SonarReading(0, 0.1, 0.0, heading, range_m, received)


def clear(point: tuple[float, float], *readings: SonarReading) -> bool:
    view = fresh_sonar(readings, NOW, standing(), P)
    return view is not None and bool(clear_by_sonar(np.array([point]), view, P)[0])


def test_a_cone_is_clear_up_to_its_echo_or_range() -> None:
    assert clear((1.0, 0.0), ahead(1.5))
    assert clear((1.0, 0.2), ahead(1.5))
    assert not clear((1.0, 0.3), ahead(1.5))
    assert not clear((1.65, 0.0), ahead(1.5))
    assert clear((2.0, 0.0), ahead(None))
    assert not clear((2.2, 0.0), ahead(None))
    assert not clear((-0.3, 0.0), ahead(None))


def test_a_reading_clears_less_with_age_and_then_expires() -> None:
    assert clear((1.4, 0.0), ahead(1.5))
    assert not clear((1.4, 0.0), ahead(1.5, NOW - 0.4))
    assert not clear((0.5, 0.0), ahead(1.5, NOW - P.sonar_fresh_s - 0.01))
    assert fresh_sonar((), NOW, standing(), P) is None


def test_a_reading_newer_than_the_query_counts() -> None:
    assert clear((1.4, 0.0), ahead(1.5, NOW + 0.003))
    assert not clear((1.6, 0.0), ahead(1.5, NOW + 0.003))


def test_a_narrow_gap_between_two_cones_is_clear() -> None:
    pair = [
        SonarReading(k, 0.1, 0.0, math.radians(sign * 30), None, NOW)
        for k, sign in enumerate((1, -1))
    ]
    # The gap between the cones is 0.27 m at 0.6 m and 0.5 m at 1.1 m.
    assert clear((0.6, 0.0), *pair)
    assert not clear((1.1, 0.0), *pair)
    # With one sonar alone there is no second cone.
    assert not clear((0.6, 0.0), pair[0])
    # An object there returns an echo.
    assert not clear((0.6, 0.0), *pair, ahead(0.4))


def test_a_reading_is_shifted_by_the_robots_motion() -> None:
    past = DeadReckoning()
    for k in range(11):
        past.advance(NOW - 0.2 + 0.02 * k, 0.5, 0.0)
    view = fresh_sonar([ahead(1.0, NOW - 0.2)], NOW, past, P)
    assert view is not None
    # 0.1 m further back, where the reading was taken.
    assert view.x[0] == pytest.approx(0.0)
    assert view.clear_m[0] == pytest.approx(1.0 - 0.04 - 0.1)
    turned = DeadReckoning()
    for k in range(11):
        turned.advance(NOW - 0.2 + 0.02 * k, 0.0, 1.0)
    view = fresh_sonar([ahead(1.0, NOW - 0.2)], NOW, turned, P)
    assert view is not None
    assert view.heading[0] == pytest.approx(-0.2)


def test_an_echo_may_be_anywhere_across_the_cone() -> None:
    view = fresh_sonar([ahead(0.5)], NOW, standing(), P)
    assert view is not None
    points = np.array([(0.61, 0.0), (0.6, 0.12), (0.4, 0.0), (0.6, 0.3), (-0.5, 0.0)])
    assert echo_at(points, view, P)[0].tolist() == [True, True, False, False, False]
