"""Where people may be: means, spread and weights, known by construction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from observer.guard.sight import SeenObstacle
from observer.navigation.futures import displaced, futures, spread_of
from observer.navigation.habits import Habits
from observer.navigation.parameters import NavigationParameters

PRIOR, NOISE = NavigationParameters().prior, NavigationParameters().acceleration_noise
TIMES = np.array([0.5, 1.0, 2.0])
WALKER = SeenObstacle(7, 1.0, 2.0, 1.2, 0.0, 0.3, 0.05, 0.1, False)


def test_predicted_means_follow_each_manoeuvre() -> None:
    made = futures([WALKER], np.array([PRIOR]), TIMES, NOISE)
    assert made.ids == (7,)
    assert made.mean[0, 0] == pytest.approx(np.stack([1.0 + 1.2 * TIMES, [2.0] * 3], axis=1))
    stops = made.mean[0, 1]
    # The distance covered by a person who halves the speed every 0.35 s.
    assert stops[-1, 0] == pytest.approx(1.0 + 1.2 * 0.35 / math.log(2), abs=0.02)
    left, right = made.mean[0, 2], made.mean[0, 3]
    assert left[:, 0] == pytest.approx(right[:, 0])
    assert left[:, 1] - 2.0 == pytest.approx(2.0 - right[:, 1])
    assert (np.diff(left[:, 1]) > 0).all()


def test_turning_keeps_the_length_of_the_path() -> None:
    fine = np.linspace(0.01, 2.0, 400)
    path = displaced(np.array([[0.6, -0.8]]), fine)[0]
    for each in (path[0], path[2], path[3]):
        steps = np.hypot(*np.diff(each, axis=0).T)
        assert steps.sum() == pytest.approx(fine[-1] - fine[0], rel=1e-3)


def test_uncertainty_grows_and_unknown_sigmas_increase_it() -> None:
    sure = futures([WALKER], np.array([PRIOR]), TIMES, NOISE).sigma[0, 0]
    assert (np.diff(sure) > 0).all()
    assert sure[0] >= math.hypot(0.05, 0.05)
    unknown = replace(WALKER, position_sigma_m=None, velocity_sigma_mps=None)
    assert (futures([unknown], np.array([PRIOR]), TIMES, NOISE).sigma[0, 0] > sure).all()


def test_the_spread_is_that_of_a_velocity_that_returns_to_its_mean() -> None:
    """Its covariance integrated in steps; a free random walk would spread 1.4 times as far."""
    step, settling, density = 1e-3, 4.0, 0.5
    place, both, velocity = 0.0, 0.0, 0.0
    for _ in range(4000):
        place += 2 * both * step
        both += (velocity - both / settling) * step
        velocity += (density**2 - 2 * velocity / settling) * step
    exact = replace(WALKER, position_sigma_m=0.0, velocity_sigma_mps=0.0)
    (sigma,) = spread_of(exact, np.array([4.0]), density)
    assert sigma == pytest.approx(math.sqrt(place), rel=0.01)
    assert sigma < density * math.sqrt(4.0**3 / 3) / 1.3


def test_the_manoeuvre_of_a_person_out_of_view_began_when_the_person_was_last_seen() -> None:
    """The same places, whether predicted at the last sight or half a second after it."""
    later = futures([WALKER], np.array([PRIOR]), TIMES, NOISE, [0.5])
    seen = futures([WALKER], np.array([PRIOR]), TIMES + 0.5, NOISE)
    np.testing.assert_allclose(later.mean, seen.mean)
    np.testing.assert_allclose(later.sigma, seen.sigma)
    assert later.times == pytest.approx(TIMES)


def test_no_people_give_no_futures() -> None:
    assert len(futures([], np.zeros((0, len(PRIOR))), TIMES, NOISE)) == 0


def test_habits_follow_observed_behaviour() -> None:
    habits = Habits()
    assert habits.weights([WALKER], 0.0, PRIOR)[0] == pytest.approx(PRIOR)
    turning = WALKER
    for k in range(1, 6):
        angle = 0.9 * 0.4 * k
        turning = replace(WALKER, vx=1.2 * math.cos(angle), vy=1.2 * math.sin(angle))
        weights = habits.weights([turning], 0.4 * k, PRIOR)[0]
    assert weights.sum() == pytest.approx(1.0)
    assert weights[2] > 3 * PRIOR[2] > 3 * weights[3]
    # Other people start from the prior.
    assert habits.weights([replace(turning, id=8)], 2.4, PRIOR)[0] == pytest.approx(PRIOR)


def test_habits_of_people_out_of_view_fade() -> None:
    habits = Habits()
    habits.weights([WALKER], 0.0, PRIOR)
    turned = replace(WALKER, vx=1.2 * math.cos(0.36), vy=1.2 * math.sin(0.36))
    before = habits.weights([turned], 0.4, PRIOR)[0]
    assert before[2] > 2 * PRIOR[2]
    # A single frame without the person changes nothing; each interval brings the prior nearer.
    assert habits.weights([turned], 0.5, PRIOR, {7})[0] == pytest.approx(before)
    off = [
        np.abs(habits.weights([turned], 0.4 + 0.1 * k, PRIOR, {7})[0] - PRIOR).sum()
        for k in range(1, 22)
    ]
    assert (np.diff(off) <= 0).all()
    assert off[-1] < 0.2 * np.abs(before - PRIOR).sum()


def test_the_predicted_velocity_of_a_person_out_of_view_confirms_no_habit() -> None:
    habits = Habits()
    habits.weights([WALKER], 0.0, PRIOR)
    goes_on = habits.weights([WALKER], 0.4, PRIOR)[0][0]
    for k in range(5, 25):
        weights = habits.weights([WALKER], 0.1 * k, PRIOR, {7})[0]
        assert PRIOR[0] <= weights[0] <= goes_on
    # Nothing is known of a person who comes into question only now.
    assert habits.weights([replace(WALKER, id=8)], 2.4, PRIOR, {8})[0] == pytest.approx(PRIOR)


def test_a_jump_in_velocity_that_no_permitted_manoeuvre_explains_keeps_the_weights() -> None:
    """The prior excludes stopping and turning, and the track seems to stop from 20 m/s."""
    only = (1.0, 0.0, 0.0, 0.0)
    habits, fast = Habits(), replace(WALKER, vx=20.0)
    habits.weights([fast], 0.0, only)
    made = habits.weights([replace(fast, vx=0.0)], 0.5, only)
    assert made[0] == pytest.approx(only)
