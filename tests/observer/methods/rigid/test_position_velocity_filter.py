"""Sums of sightings against least squares over all of them at once."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.kernels.motion_test import own_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter

from ...kernels.oracles.motion_test import moving_position

quick = settings(max_examples=40)
seeds = st.integers(0, 2**32 - 1)
memories = st.floats(0.05, 20.0)


def informations(rng: np.random.Generator, count: int) -> np.ndarray:
    """(N, 3, 3) random: deviations from a millimetre to half a metre, along any axes."""
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    sigma = 10 ** rng.uniform(-3, -0.3, (count, 3))
    return (axes / sigma[:, None] ** 2) @ np.swapaxes(axes, 1, 2)


def gathered(
    places: np.ndarray, weights: np.ndarray, times: np.ndarray, memory_s: float
) -> PositionVelocityFilter:
    """The sums of sightings (F, N, 3) with information (F, N, 3, 3) at times (F,)."""
    sums = PositionVelocityFilter.begin(places[0], weights[0])
    for place, weight, dt in zip(places[1:], weights[1:], np.diff(times), strict=True):
        sums = sums.advanced(float(dt), memory_s).with_sightings(place, weight)
    return sums


def by_least_squares(
    place: np.ndarray, weight: np.ndarray, times: np.ndarray, memory_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position at the last time and velocity (6,) of one point, and covariance (6, 6)."""
    since = times - times[-1]
    roots, wanted = [], []
    for z, L, s in zip(place, weight, since, strict=True):
        root = np.linalg.cholesky(L).T * np.exp(s / memory_s / 2)
        roots.append(root @ np.hstack([np.eye(3), s * np.eye(3)]))
        wanted.append(root @ z)
    A, b = np.vstack(roots), np.concatenate(wanted)
    return np.linalg.lstsq(A, b, rcond=None)[0], np.linalg.inv(A.T @ A)


def excess_of(sums: PositionVelocityFilter) -> np.ndarray:
    """(N,) factor by which the sightings scatter more about a straight course than their noise."""
    count = len(sums.count)
    return own_motion(
        np.full(count, 100), np.ones(count, np.bool_), sums.origin, sums.a0, sums.position_cov,
        sums.a1, sums.a2, sums.b0, sums.b1, sums.c0, sums.count, 2,
    )[-1]  # fmt: skip


def velocity_of(sums: PositionVelocityFilter) -> tuple[np.ndarray, np.ndarray]:
    information, vector = sums.velocity_information()
    cov = np.linalg.inv(information)
    return np.einsum("nij,nj->ni", cov, vector), cov


def sightings(
    seed: int, count: int = 3, frames: int = 9
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.03, 0.2, frames))
    weights = np.stack([informations(rng, count) for _ in times])
    start, velocity = rng.uniform(-5, 5, (count, 3)), rng.normal(0, 2, (count, 3))
    straight = start + velocity * times[:, None, None]
    return straight, straight + rng.normal(0, 0.02, straight.shape), weights, times


@quick
@given(seeds, memories)
def test_the_sums_match_least_squares_over_all_sightings(seed: int, memory_s: float) -> None:
    _, places, weights, times = sightings(seed)
    sums = gathered(places, weights, times, memory_s)
    velocity, velocity_cov = velocity_of(sums)
    position, position_cov = moving_position(sums, velocity, velocity_cov)
    for n in range(places.shape[1]):
        state, cov = by_least_squares(places[:, n], weights[:, n], times, memory_s)
        scale = np.sqrt(np.diag(cov))
        np.testing.assert_allclose((position[n] - state[:3]) / scale[:3], 0, atol=1e-4)
        np.testing.assert_allclose((velocity[n] - state[3:]) / scale[3:], 0, atol=1e-4)
        np.testing.assert_allclose(
            position_cov[n] / np.outer(scale[:3], scale[:3]),
            cov[:3, :3] / np.outer(scale[:3], scale[:3]), atol=1e-4,
        )  # fmt: skip
        np.testing.assert_allclose(
            velocity_cov[n] / np.outer(scale[3:], scale[3:]),
            cov[3:, 3:] / np.outer(scale[3:], scale[3:]), atol=1e-4,
        )  # fmt: skip


@quick
@given(seeds, memories)
def test_a_straight_course_is_exact_and_has_no_excess(seed: int, memory_s: float) -> None:
    straight, _, weights, times = sightings(seed)
    sums = gathered(straight, weights, times, memory_s)
    truth = (straight[-1] - straight[0]) / (times[-1] - times[0])
    velocity, _ = velocity_of(sums)
    np.testing.assert_allclose(velocity, truth, atol=1e-4)
    np.testing.assert_allclose(sums.moving_position(truth), straight[-1], atol=1e-6)
    np.testing.assert_allclose(excess_of(sums), 1.0, atol=1e-2)


def test_the_static_position_is_the_weighted_mean() -> None:
    rng = np.random.default_rng(2)
    place = rng.uniform(-3, 3, (4, 3))
    weights = np.stack([informations(rng, 4) for _ in range(6)])
    places = place + rng.normal(0, 0.1, (6, 4, 3))
    sums = gathered(places, weights, np.arange(6) * 0.1, 1e9)
    position, cov = sums.static_position()
    total = weights.sum(axis=0)
    mean = np.linalg.solve(total, np.einsum("fnij,fnj->ni", weights, places)[..., None])[..., 0]
    np.testing.assert_allclose(position, mean, atol=1e-6)
    np.testing.assert_allclose(cov, np.linalg.inv(total), rtol=1e-5, atol=1e-12)


@quick
@given(seeds, memories, st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_one_or_two_time_steps_give_the_same_result(
    seed: int, memory_s: float, first: float, second: float
) -> None:
    _, places, weights, times = sightings(seed)
    sums = gathered(places, weights, times, memory_s)
    once = sums.advanced(first + second, memory_s)
    twice = sums.advanced(first, memory_s).advanced(second, memory_s)
    for field in fields(PositionVelocityFilter):
        a, b = getattr(once, field.name), getattr(twice, field.name)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(b).max()))


def test_the_weight_of_a_sighting_decays_by_e_per_memory_time() -> None:
    memory_s = 0.7
    sums = PositionVelocityFilter.begin(np.zeros((1, 3)), np.eye(3)[None]).advanced(
        memory_s, memory_s
    )
    np.testing.assert_allclose(sums.a0[0], np.eye(3) / np.e)
    assert sums.count[0] == pytest.approx(1 / np.e)
    now = sums.with_sightings(np.array([[1.0, 0, 0]]), np.eye(3)[None])
    assert now.static_position()[0][0, 0] == pytest.approx(1 / (1 + 1 / np.e))


def test_a_new_velocity_replaces_the_old_one() -> None:
    dt, memory_s = 0.05, 0.3
    times = np.arange(0, 4, dt)
    x = np.where(times < 2, times, 2 - 0.5 * (times - 2))
    places = np.zeros((len(times), 1, 3))
    places[:, 0, 0] = x
    weights = np.broadcast_to(np.eye(3) * 1e4, (len(times), 1, 3, 3))
    last = int(np.searchsorted(times, 2.0))
    before, _ = velocity_of(gathered(places[:last], weights[:last], times[:last], memory_s))
    after, _ = velocity_of(gathered(places, weights, times, memory_s))
    assert before[0, 0] == pytest.approx(1.0, abs=1e-3)
    assert after[0, 0] == pytest.approx(-0.5, abs=0.03)
    for_ever, _ = velocity_of(gathered(places, weights, times, 1e6))
    assert for_ever[0, 0] > 0.0


def test_the_stated_covariance_matches_the_errors() -> None:
    """Joint squared Mahalanobis lengths of position and velocity follow chi-squared."""
    rng = np.random.default_rng(5)
    count, times = 3000, np.arange(7) * 0.07
    weight = informations(rng, 1)
    root = np.linalg.inv(np.linalg.cholesky(weight[0]).T)
    velocity = np.array([0.3, -0.2, 1.0])
    places = velocity * times[:, None, None] + rng.normal(size=(7, count, 3)) @ root.T
    weights = np.broadcast_to(weight, (7, count, 3, 3))
    sums = gathered(places, weights, times, 1e9)
    found, cov = velocity_of(sums)
    at, at_cov = moving_position(sums, found, cov)
    for error, stated in ((found - velocity, cov), (at - velocity * times[-1], at_cov)):
        nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(stated), error)
        assert nees.mean() == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize(("memory_s", "most"), [(1e9, 1.1), (0.5, 1.4)])
@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_the_excess_is_the_ratio_of_actual_to_stated_noise(
    factor: float, memory_s: float, most: float
) -> None:
    """If old sightings are forgotten, it may be somewhat too large, never too small."""
    rng = np.random.default_rng(6)
    count, times = 2000, np.arange(20) / 15
    places = rng.normal(0, 0.01 * factor, (20, count, 3)) + times[:, None, None]
    weights = np.broadcast_to(np.eye(3) * 1e4, (20, count, 3, 3))
    sums = gathered(places, weights, times, memory_s)
    excess = excess_of(sums)
    assert (excess >= 1).all()
    assert 0.95 < excess.mean() / factor**2 < most


def test_a_braking_or_turning_body_does_not_fit_a_straight_course() -> None:
    rng = np.random.default_rng(7)
    times = np.arange(12) / 15
    places = np.zeros((12, 3, 3))
    places[:, 0, 0] = 0.5 * times
    places[:, 1, 0] = 0.5 * np.minimum(times, 0.4)
    places[:, 2, :2] = 0.2 * np.stack([np.sin(3 * times), 1 - np.cos(3 * times)], axis=1)
    places += rng.normal(0, 0.004, places.shape)
    weights = np.broadcast_to(np.eye(3) / 0.004**2, (12, 3, 3, 3))
    sums = gathered(places, weights, times, 0.5)
    straight, braking, turning = excess_of(sums)
    assert straight < 2
    assert braking > 4
    assert turning > 4


@pytest.mark.parametrize("position", [7.0, np.nan, np.inf])
def test_a_sighting_without_information_adds_nothing(position: float) -> None:
    _, places, weights, times = sightings(8)
    sums = gathered(places, weights, times, 1.0)
    same = sums.with_sightings(np.full((3, 3), position), np.zeros((3, 3, 3)))
    for field in fields(PositionVelocityFilter):
        np.testing.assert_array_equal(getattr(same, field.name), getattr(sums, field.name))


def test_a_single_sighting_gives_no_velocity_and_an_empty_window() -> None:
    sums = PositionVelocityFilter.begin(np.ones((2, 3)), informations(np.random.default_rng(0), 2))
    for later in (sums, sums.advanced(0.2, 0.5)):
        information, vector = later.velocity_information()
        np.testing.assert_allclose(information / np.abs(later.a0).max(), 0, atol=1e-9)
        np.testing.assert_allclose(vector, 0, atol=1e-9)
        np.testing.assert_allclose(later.window_s(), 0, atol=1e-6)
        np.testing.assert_allclose(later.static_position()[0], 1.0)


def test_the_window_is_the_time_span_of_the_sightings() -> None:
    places, weight = np.zeros((2, 3)), np.broadcast_to(np.eye(3), (2, 3, 3))
    even = PositionVelocityFilter.begin(places, weight)
    for _ in range(59):
        even = even.advanced(1 / 30, 1e9).with_sightings(places, weight)
    np.testing.assert_allclose(even.window_s(), 2.0, rtol=0.01)
    # With a memory the weights fall exponentially, with the memory as standard deviation.
    fading = PositionVelocityFilter.begin(places, weight)
    for _ in range(600):
        fading = fading.advanced(0.01, 0.5).with_sightings(places, weight)
    np.testing.assert_allclose(fading.window_s(), np.sqrt(12) * 0.5, rtol=0.01)


def test_no_precision_is_lost_far_from_the_world_origin() -> None:
    _, places, weights, times = sightings(9)
    near = gathered(places, weights, times, 1.0)
    far = gathered(places + 1e5, weights, times, 1.0)
    np.testing.assert_allclose(velocity_of(far)[0], velocity_of(near)[0], atol=1e-5)
    np.testing.assert_allclose(far.static_position()[0] - 1e5, near.static_position()[0], atol=1e-5)


def test_take_and_join_select_and_order_points() -> None:
    _, places, weights, times = sightings(10, count=5)
    sums = gathered(places, weights, times, 0.5)
    mask = np.array([True, False, True, True, False])
    for some in (sums.take(mask), sums.take(np.array([0, 2, 3]))):
        np.testing.assert_array_equal(velocity_of(some)[0], velocity_of(sums)[0][mask])
    again = sums.take(~mask).joined(sums.take(mask))
    order = [1, 4, 0, 2, 3]
    for field in fields(PositionVelocityFilter):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(sums, field.name)[order])


def test_shifting_the_sums_equals_shifting_the_sightings() -> None:
    rng = np.random.default_rng(5)
    times = np.array([0.0, 0.1, 0.25, 0.3])
    places, weights = rng.normal(size=(4, 2, 3)), np.stack([informations(rng, 2) for _ in times])
    shift, drift = rng.normal(size=(2, 2, 3))
    moved = places + shift + drift * (times - times[-1])[:, None, None]
    made = gathered(places, weights, times, 0.5).shifted(shift, drift)
    wanted = gathered(moved, weights, times, 0.5)
    velocities = []
    for sums in (made, wanted):
        information, vector = sums.velocity_information()
        velocities.append(np.linalg.solve(information, vector[..., None])[..., 0])
    velocity = np.asarray(velocities[1], dtype=np.float64)
    np.testing.assert_allclose(velocities[0], velocity, rtol=1e-6, atol=1e-8)
    places_now = [sums.moving_position(velocity) for sums in (made, wanted)]
    np.testing.assert_allclose(places_now[0], places_now[1], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(excess_of(made), excess_of(wanted), rtol=1e-6)
