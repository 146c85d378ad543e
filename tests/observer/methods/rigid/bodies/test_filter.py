"""The motion filter of one obstacle against motion with known truth and noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from observer.methods.rigid.bodies.filter import (
    MEASURED,
    POSITION,
    STATE_SIZE,
    VELOCITY,
    YAW,
    YAW_RATE,
    BodyFilter,
    turning_velocity,
    yaw_matrix,
)

from .planted_bodies import DT

# Variance of the measured place (m) and yaw (rad).
NOISE = np.diag([0.01, 0.01, 0.03, 0.02]) ** 2
# m/s^2 and rad/s^2, steady and manoeuvring.
ACCELERATION, YAW_ACCELERATION = (0.1, 1.0), (0.3, 5.0)
# Standard deviations of the first state: 5 cm, 20 cm/s and 0.3 rad/s.
FIRST_SIGMA = np.array([0.05] * 3 + [0.2] * 3 + [1e-4] + [0.3])


def on_circle(state: np.ndarray, dt: float) -> np.ndarray:
    """Exact state (8,) of a body that keeps its speed and yaw rate for ``dt`` seconds."""
    out, rate = state.copy(), state[YAW_RATE]
    out[VELOCITY] = yaw_matrix(rate * dt) @ state[VELOCITY]
    if abs(rate) < 1e-9:
        out[POSITION] += dt * state[VELOCITY]
    else:
        # The velocity's integral: rotated by 90 degrees to the left and divided by the rate.
        quarter = yaw_matrix(-np.pi / 2) * [1, 0, 1]
        out[POSITION] += quarter @ (out[VELOCITY] - state[VELOCITY]) / rate
        out[1] += dt * state[4]
    out[YAW] += dt * rate
    return out


def started(state: np.ndarray, sigma: np.ndarray = FIRST_SIGMA) -> BodyFilter:
    """A filter that starts from a state (8,) with standard deviations (8,)."""
    cov = np.diag(sigma**2)
    motion = BodyFilter.begin(
        state[POSITION], state[VELOCITY], cov[POSITION, POSITION], cov[VELOCITY, VELOCITY],
        float(sigma[YAW_RATE]),
    )  # fmt: skip
    motion.means[:, YAW:] = state[YAW:]
    motion.covariances[:, YAW, YAW] = sigma[YAW] ** 2
    return motion


def truth(speed: float = 0.4, rate: float = 0.0) -> np.ndarray:
    return np.array([0.5, 0.1, 3.0, speed * 0.6, 0.0, speed * 0.8, 0.0, rate])


def squared_error(motion: BodyFilter, state: np.ndarray, rows: slice | list[int]) -> float:
    """Squared Mahalanobis length of the error."""
    gap = (motion.mean - state)[rows]
    return float(gap @ np.linalg.solve(motion.covariance[rows, rows], gap))


def inside(mean: float, draws: int, freedom: int, share: float = 0.9999) -> bool:
    low, high = np.array(chi2.interval(share, draws * freedom)) / draws
    return bool(low <= mean <= high)


@pytest.mark.parametrize("rate", [0.0, 0.6, -1.2])
def test_the_exact_circle_matches_numerical_integration(rate: float) -> None:
    state = truth(rate=rate)
    small = state
    for _ in range(20000):
        small = small.copy()
        small[VELOCITY] = yaw_matrix(rate * 5e-5) @ small[VELOCITY]
        small[POSITION] += 5e-5 * small[VELOCITY]
        small[YAW] += 5e-5 * rate
    np.testing.assert_allclose(on_circle(state, 1.0), small, atol=1e-4)


@pytest.mark.parametrize("rate", [0.0, 0.6, -1.2])
@pytest.mark.parametrize("steps", [1, 4, 30])
def test_errors_match_the_stated_covariance_under_the_modelled_noise(
    rate: float, steps: int
) -> None:
    """Normalised squared errors over many draws, for a truth that accelerates as modelled."""
    draws, rng, found = 120, np.random.default_rng(steps), []
    a, yaw_a = 0.5, 1.0
    for _ in range(draws):
        state = truth(rate=rate)
        motion = started(state + rng.normal(0, FIRST_SIGMA))
        for _ in range(steps):
            jolt, twist = rng.normal(0, a, 3), rng.normal(0, yaw_a)
            state = on_circle(state, DT)
            state[POSITION] += DT**2 / 2 * jolt
            state[VELOCITY] += DT * jolt
            state[YAW] += DT**2 / 2 * twist
            state[YAW_RATE] += DT * twist
            motion = motion.predicted(DT, (a, a), (yaw_a, yaw_a), None)
            measured = state[MEASURED] + rng.multivariate_normal(np.zeros(4), NOISE)
            motion = motion.updated(measured, NOISE)
        found.append(squared_error(motion, state, slice(None)))
    assert inside(float(np.mean(found)), draws, STATE_SIZE), np.mean(found) / STATE_SIZE


@pytest.mark.parametrize("rate", [0.0, 0.5])
def test_the_covariance_of_steady_motion_is_never_too_small(rate: float) -> None:
    draws, rng = 100, np.random.default_rng(1)
    errors: dict[str, list[float]] = {"place": [], "velocity": [], "turn": []}
    for _ in range(draws):
        state = truth(rate=rate)
        motion = started(state + rng.normal(0, FIRST_SIGMA))
        for _ in range(30):
            state = on_circle(state, DT)
            motion = motion.predicted(DT, ACCELERATION, YAW_ACCELERATION, None)
            measured = state[MEASURED] + rng.multivariate_normal(np.zeros(4), NOISE)
            motion = motion.updated(measured, NOISE)
        for kept, rows in zip(
            errors.values(), (POSITION, VELOCITY, slice(YAW, STATE_SIZE)), strict=True
        ):
            kept.append(squared_error(motion, state, rows))
    for name, kept in errors.items():
        freedom = 2 if name == "turn" else 3
        assert np.mean(kept) < chi2.ppf(0.999, draws * freedom) / draws, name
        # nor uselessly large
        assert np.mean(kept) > 0.1 * freedom, name


def test_two_modes_are_smooth_in_steady_motion_and_quick_when_braking() -> None:
    """Steady: as good as the steady mode alone. Braking: almost as quick as the other one."""
    rng = np.random.default_rng(2)
    modes = {
        "both": ACCELERATION,
        "steady": (ACCELERATION[0],) * 2,
        "agile": (ACCELERATION[1],) * 2,
    }
    errors: dict[str, dict[str, list[float]]] = {
        name: {"steady": [], "braking": []} for name in modes
    }
    for _ in range(30):
        states = [truth(speed=0.6)]
        for k in range(60):
            state = on_circle(states[-1], DT)
            if k >= 40:
                speed = max(0.0, 0.6 - 1.5 * (k - 39) * DT)
                state[VELOCITY] = speed * np.array([0.6, 0, 0.8])
            states.append(state)
        noise = rng.multivariate_normal(np.zeros(4), NOISE, len(states))
        for name, acceleration in modes.items():
            motion = started(states[0])
            for k, state in enumerate(states[1:]):
                motion = motion.predicted(DT, acceleration, YAW_ACCELERATION, None)
                motion = motion.updated(state[MEASURED] + noise[k], NOISE)
                error = float(np.linalg.norm((motion.mean - state)[VELOCITY]))
                if 20 <= k < 40:
                    errors[name]["steady"].append(error**2)
                elif 43 <= k < 55:
                    errors[name]["braking"].append(error**2)
    rms = {n: {k: np.sqrt(np.mean(v)) for k, v in e.items()} for n, e in errors.items()}
    assert rms["both"]["steady"] < 0.75 * rms["agile"]["steady"]
    assert rms["both"]["braking"] < 0.75 * rms["steady"]["braking"]


@pytest.mark.parametrize("rate", [0.0, 0.5, -0.8])
def test_a_known_body_is_predicted_along_its_circle(rate: float) -> None:
    state = truth(rate=rate)
    motion = started(state, np.full(STATE_SIZE, 1e-4))
    for _ in range(15):
        motion = motion.predicted(DT, (1e-3, 1e-3), (1e-3, 1e-3), None)
    np.testing.assert_allclose(motion.mean, on_circle(state, 1.0), atol=5e-4)


@given(
    parts=st.lists(st.floats(0.02, 0.2), min_size=2, max_size=5),
    rate=st.floats(-1.0, 1.0),
)
@settings(max_examples=40)
def test_prediction_adds_up_over_time(parts: list[float], rate: float) -> None:
    """Without noise, one step or several give the same mean and covariance."""
    state = truth(rate=rate)
    sigma = np.array([0.02] * 3 + [0.05] * 3 + [0.01, 0.02])
    once = started(state, sigma).predicted(sum(parts), (0, 0), (0, 0), None)
    often = started(state, sigma)
    for dt in parts:
        often = often.predicted(dt, (0, 0), (0, 0), None)
    # The chord over half the turn has a second-order error: 1/24 of the turned angle squared.
    turned = abs(rate) * sum(parts)
    np.testing.assert_allclose(
        often.mean, once.mean, atol=1e-9 + 0.4 * sum(parts) * turned**2 / 24 * 1.2
    )
    scale = np.sqrt(np.diag(once.covariance))
    ratio = (often.covariance - once.covariance) / np.outer(scale, scale)
    assert np.abs(ratio).max() < 1e-6 + 0.1 * turned


def test_process_noise_adds_up_over_time() -> None:
    """White acceleration: velocity's variance grows with the number of frames."""
    motion = started(truth(speed=0.0), np.full(STATE_SIZE, 1e-6))
    for _ in range(9):
        motion = motion.predicted(DT, (0.5, 0.5), (1.0, 1.0), None)
    np.testing.assert_allclose(np.diag(motion.covariance)[VELOCITY], 9 * (DT * 0.5) ** 2, rtol=1e-3)
    assert motion.covariance[YAW_RATE, YAW_RATE] == pytest.approx(9 * DT**2, rel=1e-3)


def test_a_body_may_accelerate_more_along_its_axis_than_across_it() -> None:
    axis = np.array([0.6, 0.0, 0.8])
    motion = started(truth(), np.full(STATE_SIZE, 1e-6)).predicted(DT, (1, 1), (1, 1), axis)
    cov = motion.covariance[VELOCITY, VELOCITY]
    across = np.array([0.8, 0.0, -0.6])
    assert axis @ cov @ axis == pytest.approx(DT**2, rel=1e-3)
    assert across @ cov @ across < 0.5 * DT**2
    # A measurement along one axis then also informs about the other one.
    assert abs(cov[0, 2]) > 0.2 * np.sqrt(cov[0, 0] * cov[2, 2])


def test_the_world_origin_makes_no_difference() -> None:
    """A kilometre from the origin a body moves just as it does near it."""
    shift = np.array([400.0, -30.0, 1000.0])
    rng = np.random.default_rng(3)
    state = truth(rate=0.3)
    far_state = state.copy()
    far_state[POSITION] += shift
    near, far = started(state), started(far_state)
    for k in range(20):
        state = on_circle(state, DT)
        if k == 10:
            state[VELOCITY] *= -10  # which leaves no doubt which mode it is
        near = near.predicted(DT, (0.01, 10.0), YAW_ACCELERATION, None)
        far = far.predicted(DT, (0.01, 10.0), YAW_ACCELERATION, None)
        measured = state[MEASURED] + rng.multivariate_normal(np.zeros(4), NOISE)
        near = near.updated(measured, NOISE)
        far = far.updated(measured + np.append(shift, 0), NOISE)
        np.testing.assert_allclose(far.mean[POSITION] - shift, near.mean[POSITION], atol=1e-8)
        np.testing.assert_allclose(far.covariance, near.covariance, atol=1e-8)
        assert near.probabilities.sum() == pytest.approx(1.0, abs=1e-12)


def test_rebasing_describes_the_same_motion_at_another_point() -> None:
    """The other point of a turning body moves on its own circle."""
    state, offset = truth(rate=0.7), np.array([0.2, -0.1, 0.3])
    state[YAW] = 0.4
    motion = started(state, np.full(STATE_SIZE, 1e-3)).rebased(offset)
    step = 1e-5
    here, soon = state, on_circle(state, step)
    place, later = (s[POSITION] + yaw_matrix(s[YAW]) @ offset for s in (here, soon))
    np.testing.assert_allclose(motion.mean[POSITION], place, atol=1e-9)
    np.testing.assert_allclose(motion.mean[VELOCITY], (later - place) / step, atol=1e-4)
    assert motion.mean[YAW] == state[YAW]
    assert motion.mean[YAW_RATE] == state[YAW_RATE]
    # and a second later it is still the same body
    for _ in range(30):
        motion = motion.predicted(1 / 30, (0, 0), (0, 0), None)
    end = on_circle(state, 1.0)
    expected = end[POSITION] + yaw_matrix(end[YAW]) @ offset
    np.testing.assert_allclose(motion.mean[POSITION], expected, atol=1e-3)


def test_rebasing_there_and_back_changes_nothing() -> None:
    rng = np.random.default_rng(4)
    A = rng.normal(0, 0.05, (STATE_SIZE, STATE_SIZE))
    state = truth(rate=0.7)
    state[YAW] = -0.6
    motion = started(state)
    motion.covariances[:] = A @ A.T + 1e-4 * np.eye(STATE_SIZE)
    offset = np.array([0.2, 0.05, -0.3])
    back = motion.rebased(offset).rebased(-offset)
    np.testing.assert_allclose(back.mean, motion.mean, atol=1e-12)
    np.testing.assert_allclose(back.covariance, motion.covariance, atol=1e-12)


def test_the_covariance_at_another_point_matches_sampling() -> None:
    rng = np.random.default_rng(5)
    A = rng.normal(0, 0.01, (STATE_SIZE, STATE_SIZE))
    state, offset = truth(rate=0.7), np.array([0.4, 0.0, 0.5])
    motion = started(state)
    motion.covariances[:] = A @ A.T + 1e-5 * np.eye(STATE_SIZE)
    drawn = rng.multivariate_normal(state, motion.covariance, 20000)
    transformed = drawn.copy()
    for each, out in zip(drawn, transformed, strict=True):
        arm = yaw_matrix(each[YAW]) @ offset
        out[POSITION] += arm
        out[VELOCITY] += np.cross([0, each[YAW_RATE], 0], arm)
    expected = np.cov(transformed.T)
    scale = np.sqrt(np.diag(expected))
    gap = (motion.rebased(offset).covariance - expected) / np.outer(scale, scale)
    assert np.abs(gap).max() < 0.05
    moved = (motion.covariance - expected) / np.outer(scale, scale)
    assert np.abs(moved).max() > 0.2


@given(rate=st.floats(-3, 3), x=st.floats(-5, 5), z=st.floats(-5, 5))
def test_turning_velocity_is_the_cross_product_with_the_vertical(
    rate: float, x: float, z: float
) -> None:
    arm = np.array([x, 0.7, z])
    np.testing.assert_allclose(turning_velocity(rate, arm), np.cross([0, rate, 0], arm), atol=1e-12)
    step = 1e-6
    moved = (yaw_matrix(rate * step) @ arm - arm) / step
    np.testing.assert_allclose(turning_velocity(rate, arm), moved, atol=1e-4)


ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("predict"), st.floats(1e-3, 1.0), st.booleans()),
        st.tuples(st.just("update"), st.floats(1e-4, 1.0), st.floats(-3, 3)),
        st.tuples(st.just("rebase"), st.floats(-2, 2), st.floats(-2, 2)),
    ),
    min_size=1,
    max_size=40,
)


@given(actions=ACTIONS, rate=st.floats(-2, 2), agile=st.floats(0.01, 20))
@settings(max_examples=150)
def test_the_covariance_stays_valid_after_any_sequence_of_actions(
    actions: list[tuple[str, float, float]], rate: float, agile: float
) -> None:
    motion = started(truth(rate=rate))
    axis = np.array([0.6, 0.0, 0.8])
    for what, a, b in actions:
        if what == "predict":
            jolts = (0.1 * agile, agile)
            motion = motion.predicted(a, jolts, YAW_ACCELERATION, axis if b else None)
        elif what == "update":
            measured = motion.mean[MEASURED] + b * np.array([0.3, 0.1, 1.0, 0.2])
            motion = motion.updated(measured, np.diag([a, a, 4 * a, a]) ** 2)
        else:
            motion = motion.rebased(np.array([a, 0.1, b]))
        assert np.isfinite(motion.mean).all()
        assert motion.probabilities.sum() == pytest.approx(1.0, abs=1e-9)
        assert (motion.probabilities > 0).all()
        cov = motion.covariance
        scale = np.sqrt(np.diag(cov))
        correlation = cov / np.outer(scale, scale)
        np.testing.assert_allclose(correlation, correlation.T, atol=1e-9)
        assert np.linalg.eigvalsh(correlation)[0] > -1e-9
        np.linalg.cholesky(correlation + 1e-9 * np.eye(STATE_SIZE))


@pytest.mark.parametrize("rate", [0.0, 0.6])
def test_a_position_or_a_velocity_alone_corrects_its_own_part(rate: float) -> None:
    state = truth(rate=rate)
    for part, measure in (
        (POSITION, BodyFilter.with_position),
        (VELOCITY, BodyFilter.with_velocity),
    ):
        motion = started(state)
        seen = measure(motion, state[part] + 0.1, np.eye(3) * 1e-8)
        np.testing.assert_allclose(seen.mean[part], state[part] + 0.1, atol=1e-3)
        assert np.trace(seen.covariance[part, part]) < 1e-3 * np.trace(
            motion.covariance[part, part]
        )
        # At first the other parts are not correlated with it.
        other = np.setdiff1d(np.arange(STATE_SIZE), np.arange(STATE_SIZE)[part])
        np.testing.assert_allclose(seen.mean[other], state[other], atol=1e-12)


def test_positions_alone_give_the_velocity_over_time() -> None:
    rng, state = np.random.default_rng(6), truth()
    motion = started(
        state * np.array([1, 1, 1, 0, 0, 0, 1, 1]), FIRST_SIGMA * [1, 1, 1, 4, 4, 4, 1, 1]
    )
    for _ in range(40):
        state = on_circle(state, DT)
        motion = motion.predicted(DT, ACCELERATION, (0.0, 0.0), None)
        motion = motion.with_position(state[POSITION] + rng.normal(0, 0.01, 3), np.eye(3) * 1e-4)
    np.testing.assert_allclose(motion.mean[VELOCITY], state[VELOCITY], atol=0.08)


def test_an_uninformative_measurement_changes_nothing() -> None:
    motion = started(truth())
    for measure in (motion.with_position, motion.with_velocity):
        seen = measure(np.full(3, 5.0), np.eye(3) * 1e12)
        np.testing.assert_allclose(seen.mean, motion.mean, atol=1e-9)
        np.testing.assert_allclose(seen.covariance, motion.covariance, atol=1e-9)


def test_a_straightened_filter_keeps_its_motion_but_stops_turning() -> None:
    motion = started(truth(rate=0.8)).predicted(DT, ACCELERATION, YAW_ACCELERATION, None)
    straight = motion.straightened()
    rest = [k for k in range(STATE_SIZE) if k != YAW_RATE]
    np.testing.assert_array_equal(straight.mean[rest], motion.mean[rest])
    np.testing.assert_array_equal(
        straight.covariance[np.ix_(rest, rest)], motion.covariance[np.ix_(rest, rest)]
    )
    assert not straight.covariance[rest, YAW_RATE].any()
    assert motion.mean[YAW_RATE] == pytest.approx(0.8)
    for _ in range(15):
        straight = straight.predicted(DT, ACCELERATION, (0.0, 0.0), None)
        place = straight.mean[POSITION] + np.array([0.05, 0.0, -0.05])
        straight = straight.with_position(place, np.eye(3) * 1e-4)
    assert straight.mean[YAW] == pytest.approx(motion.mean[YAW], abs=0.02)
    assert abs(straight.mean[YAW_RATE]) < 0.01
