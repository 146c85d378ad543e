"""Oracle of ``observer.kernels.body_filter``: the same formulas by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.filter import (
    POSITION,
    STATE_SIZE,
    VELOCITY,
    YAW,
    YAW_RATE,
    turning_velocity,
    yaw_matrices,
)

# Means (2, 8), covariances (2, 8, 8) and probabilities (2,) of two modes.
Modes = tuple[Float64Array, Float64Array, Float64Array]

# Probability per second of changing from steady to manoeuvring, and back.
_CHANGES_PER_S = (1.0, 2.0)
# Share of its acceleration that a body may have across its axis.
_SIDEWAYS = 0.5


def mixed(modes: Modes) -> tuple[Float64Array, Float64Array]:
    """State (8,) and covariance (8, 8), mixed over both modes."""
    means, covariances, probabilities = modes
    mean = probabilities @ means
    gap = means - mean
    inner = (probabilities @ covariances.reshape(2, -1)).reshape(STATE_SIZE, -1)
    return mean, inner + gap.T @ (gap * probabilities[:, None])


def predicted(
    modes: Modes,
    dt: float,
    acceleration: tuple[float, float],
    yaw_acceleration: tuple[float, float],
    axis: Float64Array | None,
) -> Modes:
    """The modes ``dt`` seconds later, see ``BodyFilter.predicted``."""
    old_means, old_covariances, old_probabilities = modes
    stay = np.exp(-dt * np.array(_CHANGES_PER_S))
    change = np.array([[stay[0], 1 - stay[0]], [1 - stay[1], stay[1]]])
    joint = change * old_probabilities[:, None]
    probabilities = joint.sum(axis=0)
    weights = joint / probabilities
    mixed = weights.T @ old_means
    gap = old_means[None] - mixed[:, None]
    covs = (weights.T @ old_covariances.reshape(2, -1)).reshape(old_covariances.shape)
    covs += np.swapaxes(gap * weights.T[:, :, None], 1, 2) @ gap
    means, F = _turned(mixed, dt)
    covs = F @ covs @ np.swapaxes(F, 1, 2)
    _add_noise(covs, dt, acceleration, yaw_acceleration, axis)
    return means, covs, probabilities


def updated(
    modes: Modes, which: NDArray[np.intp], measured: Float64Array, noise: Float64Array
) -> Modes:
    """Update by a measurement (K,) of components ``which`` (K,), with covariance (K, K)."""
    old_means, P, probabilities = modes
    rows = P[:, which]
    S = rows[:, :, which] + noise
    inverse = np.linalg.inv(S)
    innovation = measured - old_means[:, which]
    gain = np.swapaxes(rows, 1, 2) @ inverse
    means = old_means + (gain @ innovation[:, :, None])[:, :, 0]
    left = np.tile(np.eye(STATE_SIZE), (2, 1, 1))
    left[:, :, which] -= gain
    covs = left @ P @ np.swapaxes(left, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
    squared = np.einsum("mi,mij,mj->m", innovation, inverse, innovation)
    likelihood = -0.5 * (squared + np.linalg.slogdet(S)[1])
    weight = probabilities * np.exp(likelihood - likelihood.max())
    weight = np.maximum(weight / weight.sum(), 1e-3)
    return means, covs, weight / weight.sum()


def _turned(means: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
    """The states (M, 8) after ``dt`` on circles, and the derivatives (M, 8, 8) by those before."""
    rate = means[:, YAW_RATE]
    R, half = yaw_matrices(rate * dt), yaw_matrices(rate * (dt / 2))
    v = means[:, VELOCITY, None]
    ahead, after = (half @ v)[:, :, 0], (R @ v)[:, :, 0]
    out = means.copy()
    out[:, POSITION] += dt * ahead
    out[:, VELOCITY] = after
    out[:, YAW] += dt * rate
    F = np.tile(np.eye(STATE_SIZE), (len(means), 1, 1))
    F[:, POSITION, VELOCITY] = dt * half
    F[:, POSITION, YAW_RATE] = turning_velocity(dt * dt / 2, ahead)
    F[:, VELOCITY, VELOCITY] = R
    F[:, VELOCITY, YAW_RATE] = turning_velocity(dt, after)
    F[:, YAW, YAW_RATE] = dt
    return out, F


def _add_noise(
    covs: Float64Array,
    dt: float,
    acceleration: tuple[float, float],
    yaw_acceleration: tuple[float, float],
    axis: Float64Array | None,
) -> None:
    spread = np.eye(3)
    if axis is not None:
        along = axis[:, None] * axis
        spread = along + _SIDEWAYS**2 * (spread - along)
    spread = np.square(acceleration)[:, None, None] * spread
    yaw = np.square(yaw_acceleration)
    far, cross, fast = dt**4 / 4, dt**3 / 2, dt**2
    covs[:, POSITION, POSITION] += far * spread
    covs[:, POSITION, VELOCITY] += cross * spread
    covs[:, VELOCITY, POSITION] += cross * spread
    covs[:, VELOCITY, VELOCITY] += fast * spread
    covs[:, YAW, YAW] += far * yaw
    covs[:, YAW, YAW_RATE] += cross * yaw
    covs[:, YAW_RATE, YAW] += cross * yaw
    covs[:, YAW_RATE, YAW_RATE] += fast * yaw


def velocity_at_centre(
    mean: Float64Array, cov: Float64Array, arm: Float64Array, lasting: Float64Array, doubt_m: float
) -> tuple[Float64Array, Float64Array]:
    """Velocity (3,) of a body's centre, and its covariance (3, 3), see the kernel."""
    swing = turning_velocity(1.0, arm)
    mixed = cov[VELOCITY, YAW_RATE, None] * swing
    turning = cov[YAW_RATE, YAW_RATE] * swing[:, None] * swing
    level = np.diag([1.0, 0.0, 1.0]) * (doubt_m * mean[YAW_RATE]) ** 2
    velocity = mean[VELOCITY] + turning_velocity(float(mean[YAW_RATE]), arm)
    return velocity, cov[VELOCITY, VELOCITY] + mixed + mixed.T + turning + lasting + level
