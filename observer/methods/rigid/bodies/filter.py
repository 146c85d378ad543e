"""The motion of one obstacle: place, velocity, yaw and yaw rate, steady or manoeuvring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array

# State: position (3) m, velocity (3) m/s, yaw rad, yaw rate rad/s; world frame.
POSITION, VELOCITY = slice(0, 3), slice(3, 6)
YAW, YAW_RATE = 6, 7
STATE_SIZE = 8
# What is measured: position and yaw.
MEASURED = np.array([0, 1, 2, YAW])
# Probability per second of changing from steady to manoeuvring, and back.
_CHANGES_PER_S = (1.0, 2.0)
# Share of its acceleration that a body may have across its axis.
_SIDEWAYS = 0.5
# rad/s: the yaw rate of a body whose yaw nothing shows, so small that it stays what it is.
_STRAIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class BodyFilter:
    """An interacting-multiple-model filter with two modes (Blom and Bar-Shalom, 1988).

    Both modes are the coordinated turn: the velocity turns with the body. They differ in how
    strongly it may accelerate. In the mean the filter is quick where the measurement is good
    (across the line of sight) and patient where it is not (along it).

    Attributes:
        means: (2, 8), covariances: (2, 8, 8), probabilities: (2,) of steady and manoeuvring.
    """

    means: Float64Array
    covariances: Float64Array
    probabilities: Float64Array

    @staticmethod
    def begin(
        position: Float64Array,
        velocity: Float64Array,
        position_cov: Float64Array,
        velocity_cov: Float64Array,
        yaw_rate_sigma: float,
    ) -> BodyFilter:
        """Begin with (3,) and (3, 3) each; the yaw is 0 by definition at first."""
        mean = np.zeros(STATE_SIZE)
        mean[POSITION], mean[VELOCITY] = position, velocity
        cov = np.zeros((STATE_SIZE, STATE_SIZE))
        cov[POSITION, POSITION], cov[VELOCITY, VELOCITY] = position_cov, velocity_cov
        cov[YAW, YAW], cov[YAW_RATE, YAW_RATE] = 1e-8, yaw_rate_sigma**2
        return BodyFilter(np.stack([mean, mean]), np.stack([cov, cov]), np.array([0.5, 0.5]))

    @cached_property
    def mean(self) -> Float64Array:
        """State (8,), mixed over both modes."""
        return self.probabilities @ self.means

    @cached_property
    def covariance(self) -> Float64Array:
        """Covariance (8, 8), mixed over both modes."""
        gap = self.means - self.mean
        inner = (self.probabilities @ self.covariances.reshape(2, -1)).reshape(STATE_SIZE, -1)
        return np.asarray(inner + gap.T @ (gap * self.probabilities[:, None]), np.float64)

    @cached_property
    def rotation(self) -> Float64Array:
        """(3, 3) from the body's frame to the world's, not to be written to."""
        R = yaw_matrix(float(self.mean[YAW]))
        R.setflags(write=False)
        return R

    @property
    def manoeuvres(self) -> bool:
        """True if it more likely brakes, gains speed or begins to turn than drives steadily."""
        return bool(self.probabilities[1] > 0.5)

    def shifted(self, shift: Float64Array, drift: Float64Array) -> BodyFilter:
        """The same state elsewhere, by (3,) metres, and at another velocity, by (3,) m/s."""
        return BodyFilter(
            self.means + np.concatenate([shift, drift, [0.0, 0.0]]),
            self.covariances,
            self.probabilities,
        )

    def predicted(
        self,
        dt: float,
        acceleration: tuple[float, float],
        yaw_acceleration: tuple[float, float],
        axis: Float64Array | None,
    ) -> BodyFilter:
        """The state ``dt`` seconds later.

        Args:
            acceleration: m/s^2, yaw_acceleration: rad/s^2; one standard deviation of white noise
                over a frame, steady and manoeuvring.
            axis: (3,) along which the body accelerates and brakes most, unit length, as wheels
                make it; None where unknown. What is seen well across the line of sight then also
                tells what happens along it.
        """
        stay = np.exp(-dt * np.array(_CHANGES_PER_S))
        change = np.array([[stay[0], 1 - stay[0]], [1 - stay[1], stay[1]]])
        joint = change * self.probabilities[:, None]
        probabilities = joint.sum(axis=0)
        weights = joint / probabilities
        mixed = weights.T @ self.means
        gap = self.means[None] - mixed[:, None]
        covs = (weights.T @ self.covariances.reshape(2, -1)).reshape(self.covariances.shape)
        covs += np.swapaxes(gap * weights.T[:, :, None], 1, 2) @ gap
        means, F = _turned(mixed, dt)
        covs = F @ covs @ np.swapaxes(F, 1, 2)
        _add_noise(covs, dt, acceleration, yaw_acceleration, axis)
        return BodyFilter(means, covs, probabilities)

    def updated(self, measured: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of position and yaw (4,) with covariance (4, 4)."""
        return self._updated(MEASURED, measured, noise)

    def with_position(self, position: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of the position (3,) alone, with covariance (3, 3)."""
        return self._updated(np.arange(3), position, noise)

    def with_velocity(self, velocity: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of the velocity (3,) alone, with covariance (3, 3)."""
        return self._updated(np.arange(3, 6), velocity, noise)

    def straightened(self) -> BodyFilter:
        """The same motion of a body that turns no more than its velocity tells."""
        means, covs = self.means.copy(), self.covariances.copy()
        means[:, YAW_RATE] = 0.0
        covs[:, YAW_RATE, :] = covs[:, :, YAW_RATE] = 0.0
        covs[:, YAW_RATE, YAW_RATE] = _STRAIGHT**2
        return BodyFilter(means, covs, self.probabilities)

    def doubted(self, velocity_cov: Float64Array) -> BodyFilter:
        """The same motion, whose velocity may differ further, by a covariance (3, 3) (m/s)^2."""
        covs = self.covariances.copy()
        covs[:, VELOCITY, VELOCITY] += velocity_cov
        return BodyFilter(self.means, covs, self.probabilities)

    def _updated(
        self, which: NDArray[np.intp], measured: Float64Array, noise: Float64Array
    ) -> BodyFilter:
        """Update by a measurement (K,) of components ``which`` (K,), with covariance (K, K)."""
        P = self.covariances
        rows = P[:, which]
        S = rows[:, :, which] + noise
        inverse = np.linalg.inv(S)
        innovation = measured - self.means[:, which]
        gain = np.swapaxes(rows, 1, 2) @ inverse
        means = self.means + (gain @ innovation[:, :, None])[:, :, 0]
        left = np.tile(np.eye(STATE_SIZE), (2, 1, 1))
        left[:, :, which] -= gain
        covs = left @ P @ np.swapaxes(left, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
        squared = np.einsum("mi,mij,mj->m", innovation, inverse, innovation)
        likelihood = -0.5 * (squared + np.linalg.slogdet(S)[1])
        weight = self.probabilities * np.exp(likelihood - likelihood.max())
        weight = np.maximum(weight / weight.sum(), 1e-3)
        return BodyFilter(means, covs, weight / weight.sum())

    def rebased(self, offset: Float64Array) -> BodyFilter:
        """The same motion, told of another point of the body as its origin.

        Args:
            offset: (3,) metres, the body's frame, from the old origin to the new one.
        """
        means = self.means.copy()
        rate = means[:, YAW_RATE, None]
        arm = yaw_matrices(means[:, YAW]) @ offset
        swing = turning_velocity(1.0, arm)
        means[:, POSITION] += arm
        means[:, VELOCITY] += rate * swing
        J = np.tile(np.eye(STATE_SIZE), (2, 1, 1))
        J[:, POSITION, YAW] = swing
        J[:, VELOCITY, YAW] = rate * turning_velocity(1.0, swing)
        J[:, VELOCITY, YAW_RATE] = swing
        return BodyFilter(means, J @ self.covariances @ np.swapaxes(J, 1, 2), self.probabilities)


def turning_velocity(yaw_rate: float, arm: Float64Array) -> Float64Array:
    """(..., 3) m/s of a point at the arm (..., 3) m of a body that turns about the vertical y."""
    out = np.zeros(np.shape(arm))
    out[..., 0] = yaw_rate * arm[..., 2]
    out[..., 2] = -yaw_rate * arm[..., 0]
    return out


def yaw_matrix(yaw: float) -> Float64Array:
    """(3, 3) rotation about the y axis: positive turns z towards x, to the right."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def yaw_matrices(yaw: Float64Array) -> Float64Array:
    """(M, 3, 3) rotations by M angles (see ``yaw_matrix``)."""
    out = np.zeros((len(yaw), 3, 3))
    out[:, 0, 0] = out[:, 2, 2] = np.cos(yaw)
    out[:, 0, 2] = np.sin(yaw)
    out[:, 2, 0] = -out[:, 0, 2]
    out[:, 1, 1] = 1.0
    return out


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
