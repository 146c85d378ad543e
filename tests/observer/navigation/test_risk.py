"""Probability of contact: never below Monte Carlo's, and only where contact is possible."""

from __future__ import annotations

import numpy as np
import pytest

from observer.guard.parameters import GuardParameters
from observer.navigation.futures import Futures
from observer.navigation.risk import risk_of
from observer.navigation.rollouts import STANDING, Motion, Rollouts, braked, rollouts

TIMES = np.asarray(np.arange(1, 21) * 0.2, np.float64)
LIMITS = GuardParameters()


def people(mean: np.ndarray, sigma: float, weight: tuple[float, ...] = (1.0,)) -> Futures:
    """Return one standing person with M hypotheses at (M, 2)."""
    shape = (1, len(mean), len(TIMES))
    return Futures(
        (3,),
        np.array([0.3]),
        TIMES,
        np.broadcast_to(mean[None, :, None], (*shape, 2)),
        np.full(shape, sigma),
        np.array([weight]),
    )


def ways() -> Rollouts:
    return rollouts(Motion(0.0, 0.0, 0.0, 0.3, 0.0), 0.0, 5.0, TIMES, LIMITS)


@pytest.mark.parametrize("place", [(1.0, 0.0), (0.8, 0.5), (0.5, 1.2), (0.0, -0.7)])
@pytest.mark.parametrize("sigma", [0.1, 0.4])
def test_the_bound_holds_at_every_instant(place: tuple[float, float], sigma: float) -> None:
    rng = np.random.default_rng(5)
    drawn = rng.normal(place, sigma, (20_000, 2))
    driven = ways()
    whole = risk_of(driven, people(np.array([place]), sigma), 0.35, np.ones(driven.speed.shape))
    for way in range(0, len(driven.poses), 7):
        gaps = np.hypot(*(drawn[:, None] - driven.poses[way, None, :, :2]).transpose(2, 0, 1))
        true = (gaps < 0.65).mean(axis=0).max()
        assert whole.each[way, 0] >= true - 0.015


def test_weights_and_speed_shares_scale_the_risk() -> None:
    near, far = np.array([[0.6, 0.0], [50.0, 0.0]]), np.ones(ways().speed.shape)
    half = risk_of(ways(), people(near, 0.05, (0.5, 0.5)), 0.35, far)
    assert half.each[1, 0] == pytest.approx(0.5, abs=0.01)
    assert risk_of(ways(), people(near, 0.05, (0.0, 1.0)), 0.35, far).each.max() == 0
    assert risk_of(ways(), people(near, 0.05, (1.0, 0.0)), 0.35, 0.25 * far).each[
        1, 0
    ] == pytest.approx(0.25, abs=0.01)


def test_the_time_of_contact_is_estimated() -> None:
    risk = risk_of(ways(), people(np.array([[1.2, 0.0]]), 0.05), 0.35, np.ones(ways().speed.shape))
    # From 0.3 m/s the straight path comes within the radii after about 1.5 s.
    assert 1.2 <= risk.when_s[1, 0] <= 4.0


def test_rollouts_respect_the_limits_and_end_at_the_goal() -> None:
    now = Motion(0.0, 0.0, 1.0, 0.3, 0.4)
    driven = rollouts(now, 0.0, 0.8, TIMES, LIMITS)
    before = np.concatenate([np.full((len(driven.speed), 1), 0.3), driven.speed], axis=1)
    change = np.diff(before, axis=1) / 0.2
    assert change.max() <= LIMITS.acceleration_mps2 + 1e-9
    assert change.min() >= -LIMITS.deceleration_mps2 - 1e-9
    assert np.abs(driven.turn).max() <= LIMITS.turn_rate_max_radps + 1e-9
    turned = np.diff(np.concatenate([np.full((len(driven.turn), 1), 0.4), driven.turn], axis=1))
    assert np.abs(turned).max() / 0.2 <= LIMITS.turn_acceleration_radps2 + 1e-9
    assert (driven.driven_m() < 0.95).all()
    assert driven.speed[STANDING, -1] == 0.0


def test_braking_ends_at_a_standstill() -> None:
    stopped = braked(ways(), 2, LIMITS)
    assert (stopped.speed[:, -1] == 0).all()
    assert np.array_equal(stopped.poses[:, :2], ways().poses[:, :2])
