"""Steps of the filter of a body's motion, see ``BodyFilter``, on arrays of a few numbers."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    PAIR,
    REAL,
    REALS1,
    REALS2,
    REALS3,
    WHOLE,
    WHOLES1,
    Indices,
    Reals,
    kernel,
    part,
)
from observer.kernels.small import inverse, inverse_symmetric, squared_length

# Position (3), velocity (3), yaw, yaw rate.
_SIZE, _YAW, _YAW_RATE = 8, 6, 7
# Rate per second of changing from steady to manoeuvring, and back.
_CHANGES_PER_S = (1.0, 2.0)
# Acceleration of a body across its axis, as a share of that along it.
_SIDEWAYS = 0.5
# No mode ever becomes less likely than this.
_LEAST_PROBABILITY = 1e-3


@part
def _through(F: Reals, P: Reals, out: Reals) -> None:
    """Write F P F^T of matrices (8, 8), P symmetric."""
    FP = np.empty((_SIZE, _SIZE))
    for i in range(_SIZE):
        for j in range(_SIZE):
            total = 0.0
            for k in range(_SIZE):
                total += F[i, k] * P[k, j]
            FP[i, j] = total
    for i in range(_SIZE):
        for j in range(i + 1):
            total = 0.0
            for k in range(_SIZE):
                total += FP[i, k] * F[j, k]
            out[i, j] = out[j, i] = total


@part
def _mix(
    means: Reals, covariances: Reals, first: float, second: float, mean: Reals, cov: Reals
) -> None:
    """Write mean (8,) and covariance (8, 8) of a mixture of two modes with these probabilities."""
    for k in range(_SIZE):
        mean[k] = first * means[0, k] + second * means[1, k]
    for k in range(_SIZE):
        for m in range(_SIZE):
            cov[k, m] = (
                first * covariances[0, k, m]
                + second * covariances[1, k, m]
                + first * (means[0, k] - mean[k]) * (means[0, m] - mean[m])
                + second * (means[1, k] - mean[k]) * (means[1, m] - mean[m])
            )


@kernel(REALS2, REALS3, REALS1)
def mixed(means: Reals, covariances: Reals, probabilities: Reals) -> tuple[Reals, Reals]:
    """Return mean (8,) and covariance (8, 8) of the mixture of (2, 8), (2, 8, 8) and (2,)."""
    mean, cov = np.empty(_SIZE), np.empty((_SIZE, _SIZE))
    _mix(means, covariances, probabilities[0], probabilities[1], mean, cov)
    return mean, cov


@part
def _turn(mean: Reals, dt: float, F: Reals) -> None:
    """Advance a state (8,) along its circle, and write the derivative F (8, 8) by the old state."""
    for k in range(_SIZE):
        for m in range(_SIZE):
            F[k, m] = 1.0 if k == m else 0.0
    angle = mean[_YAW_RATE] * dt
    c, s = math.cos(angle), math.sin(angle)
    half_c, half_s = math.cos(angle / 2.0), math.sin(angle / 2.0)
    vx, vy, vz = mean[3], mean[4], mean[5]
    # The chord is parallel to the velocity at the middle of the arc.
    x, z = half_c * vx + half_s * vz, half_c * vz - half_s * vx
    mean[0] += dt * x
    mean[1] += dt * vy
    mean[2] += dt * z
    mean[3], mean[5] = c * vx + s * vz, c * vz - s * vx
    mean[_YAW] += angle
    F[0, 3] = F[2, 5] = dt * half_c
    F[0, 5], F[2, 3] = dt * half_s, -dt * half_s
    F[1, 4] = dt
    F[0, _YAW_RATE], F[2, _YAW_RATE] = dt * dt / 2.0 * z, -dt * dt / 2.0 * x
    F[3, 3] = F[5, 5] = c
    F[3, 5], F[5, 3] = s, -s
    F[3, _YAW_RATE], F[5, _YAW_RATE] = dt * mean[5], -dt * mean[3]
    F[_YAW, _YAW_RATE] = dt


@kernel(REALS2, REALS3, REALS1, REAL, PAIR, PAIR, REALS1)
def predict(
    means: Reals, covariances: Reals, probabilities: Reals, dt: float,
    acceleration: tuple[float, float], yaw_acceleration: tuple[float, float], axis: Reals,
) -> tuple[Reals, Reals, Reals]:  # fmt: skip
    """Return the modes' states (2, 8), covariances (2, 8, 8) and probabilities (2,) after ``dt`` s.

    Args:
        means, covariances, probabilities: at present. acceleration: m/s^2 and yaw_acceleration:
            rad/s^2 of each mode. axis: (3,) see ``BodyFilter.predicted``; 0 where unknown.
    """
    new_means, new_covs, new_probabilities = (
        np.empty((2, _SIZE)), np.empty((2, _SIZE, _SIZE)), np.empty(2),
    )  # fmt: skip
    F, cov = np.empty((_SIZE, _SIZE)), np.empty((_SIZE, _SIZE))
    known = axis[0] != 0.0 or axis[1] != 0.0 or axis[2] != 0.0
    across = _SIDEWAYS**2 if known else 1.0
    far, cross, fast = dt**4 / 4.0, dt**3 / 2.0, dt**2
    for n in range(2):
        # IMM mixing: the probability of arriving in this mode from each of the two.
        leaves = 1.0 - math.exp(-dt * _CHANGES_PER_S[1 - n])
        stays = math.exp(-dt * _CHANGES_PER_S[n])
        same, other = stays * probabilities[n], leaves * probabilities[1 - n]
        total = same + other
        new_probabilities[n] = total
        first, second = (same, other) if n == 0 else (other, same)
        _mix(means, covariances, first / total, second / total, new_means[n], cov)
        _turn(new_means[n], dt, F)
        _through(F, cov, new_covs[n])
        square = acceleration[n] ** 2
        for k in range(3):
            for m in range(3):
                along = axis[k] * axis[m]
                noise = square * (along + across * ((1.0 if k == m else 0.0) - along))
                new_covs[n, k, m] += far * noise
                new_covs[n, k, m + 3] += cross * noise
                new_covs[n, k + 3, m] += cross * noise
                new_covs[n, k + 3, m + 3] += fast * noise
        yaw = yaw_acceleration[n] ** 2
        new_covs[n, _YAW, _YAW] += far * yaw
        new_covs[n, _YAW, _YAW_RATE] += cross * yaw
        new_covs[n, _YAW_RATE, _YAW] += cross * yaw
        new_covs[n, _YAW_RATE, _YAW_RATE] += fast * yaw
    return new_means, new_covs, new_probabilities


@kernel(REALS2, REALS3, REALS1, WHOLES1, REALS1, REALS2)
def update(
    means: Reals, covariances: Reals, probabilities: Reals,
    which: Indices, measured: Reals, noise: Reals,
) -> tuple[Reals, Reals, Reals]:  # fmt: skip
    """Return the modes' states (2, 8), covariances (2, 8, 8) and probabilities (2,) when updated.

    Args:
        means, covariances, probabilities: as predicted. measured: (K,) measurement of the state's
            components ``which`` (K,), with covariance noise (K, K).
    """
    count = len(which)
    new_means, new_covs, new_probabilities = (
        np.empty((2, _SIZE)), np.empty((2, _SIZE, _SIZE)), np.empty(2),
    )  # fmt: skip
    S, inverted, gain = (
        np.empty((count, count)), np.empty((count, count)), np.empty((_SIZE, count)),
    )  # fmt: skip
    left, likelihood = np.empty((_SIZE, _SIZE)), np.empty(2)
    for n in range(2):
        mean, P = means[n], covariances[n]
        for k in range(count):
            for m in range(count):
                S[k, m] = P[which[k], which[m]] + noise[k, m]
        likelihood[n] = -inverse(S, inverted)
        for i in range(_SIZE):
            new_means[n, i] = mean[i]
            for j in range(_SIZE):
                left[i, j] = 1.0 if i == j else 0.0
            for k in range(count):
                gain[i, k] = 0.0
                for m in range(count):
                    gain[i, k] += P[which[m], i] * inverted[m, k]
                new_means[n, i] += gain[i, k] * (measured[k] - mean[which[k]])
                left[i, which[k]] -= gain[i, k]
        # Joseph's form, which stays positive.
        _through(left, P, new_covs[n])
        for i in range(_SIZE):
            for j in range(_SIZE):
                for k in range(count):
                    for m in range(count):
                        new_covs[n, i, j] += gain[i, k] * noise[k, m] * gain[j, m]
        for k in range(count):
            for m in range(count):
                likelihood[n] -= (
                    (measured[k] - mean[which[k]]) * inverted[k, m] * (measured[m] - mean[which[m]])
                )
    most = max(likelihood[0], likelihood[1])
    total = 0.0
    for n in range(2):
        new_probabilities[n] = probabilities[n] * math.exp(0.5 * (likelihood[n] - most))
        total += new_probabilities[n]
    for n in range(2):
        new_probabilities[n] = max(new_probabilities[n] / total, _LEAST_PROBABILITY)
    total = new_probabilities[0] + new_probabilities[1]
    for n in range(2):
        new_probabilities[n] /= total
    return new_means, new_covs, new_probabilities


@kernel(REALS1, REALS2, WHOLE, REALS2)
def squared_gap(gap: Reals, covariance: Reals, first: int, noise: Reals) -> float:
    """Return the squared Mahalanobis length of a gap (3,) to three components of a state.

    Args:
        covariance: (8, 8) of the state; the three components start at ``first``. noise: (3, 3)
            covariance of the value compared with them.
    """
    S, inverted = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        for m in range(3):
            S[k, m] = covariance[first + k, first + m] + noise[k, m]
    inverse_symmetric(S, inverted)
    return squared_length(gap, inverted)


@kernel(REALS1, REALS2, REALS1, REALS2, REAL)
def velocity_at_centre(
    state: Reals, covariance: Reals, arm: Reals, lasting: Reals, doubt_m: float
) -> tuple[Reals, Reals]:
    """Return the velocity (3,) m/s of a turning body's centre, and its covariance (3, 3).

    Args:
        state: (8,) with covariance (8, 8). arm: (3,) metres, world axes, from the origin to the
            centre, with horizontal standard deviation ``doubt_m``, metres. lasting: (3, 3)
            (m/s)^2, from systematic errors.
    """
    velocity, cov, swing = np.empty(3), np.empty((3, 3)), np.empty(3)
    swing[0], swing[1], swing[2] = arm[2], 0.0, -arm[0]
    rate, spread = state[_YAW_RATE], covariance[_YAW_RATE, _YAW_RATE]
    for k in range(3):
        velocity[k] = state[3 + k] + rate * swing[k]
        for m in range(3):
            cov[k, m] = (
                covariance[3 + k, 3 + m]
                + covariance[3 + k, _YAW_RATE] * swing[m]
                + covariance[3 + m, _YAW_RATE] * swing[k]
                + spread * swing[k] * swing[m]
                + lasting[k, m]
            )
    doubt = (doubt_m * rate) ** 2
    cov[0, 0] += doubt
    cov[2, 2] += doubt
    return velocity, cov
