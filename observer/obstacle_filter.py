"""The motion of one obstacle: place, velocity, yaw and yaw rate, steady or manoeuvring."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from observer.geometry import Float64Array

# State: position (3) m, velocity (3) m/s, yaw rad, yaw rate rad/s; world frame.
POSITION, VELOCITY = slice(0, 3), slice(3, 6)
YAW, YAW_RATE = 6, 7
STATE_SIZE = 8
# What is measured: position and yaw.
MEASURED = [0, 1, 2, YAW]
# Probability per second of changing from steady to manoeuvring, and back.
_CHANGES_PER_S = (1.0, 2.0)
# Share of its acceleration that a body may have across its axis.
_SIDEWAYS = 0.5


@dataclass(frozen=True, eq=False)
class ObstacleMotion:
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
    ) -> ObstacleMotion:
        """With (3,) and (3, 3) each; the yaw is 0 by definition at first."""
        mean = np.zeros(STATE_SIZE)
        mean[POSITION], mean[VELOCITY] = position, velocity
        cov = np.zeros((STATE_SIZE, STATE_SIZE))
        cov[POSITION, POSITION], cov[VELOCITY, VELOCITY] = position_cov, velocity_cov
        cov[YAW, YAW], cov[YAW_RATE, YAW_RATE] = 1e-8, yaw_rate_sigma**2
        return ObstacleMotion(np.stack([mean, mean]), np.stack([cov, cov]), np.array([0.5, 0.5]))

    @cached_property
    def mean(self) -> Float64Array:
        """(8,) over both modes."""
        return self.probabilities @ self.means

    @cached_property
    def covariance(self) -> Float64Array:
        """(8, 8) over both modes."""
        gap = self.means - self.mean
        spread = gap[:, :, None] * gap[:, None, :]
        return np.asarray(
            np.einsum("m,mij->ij", self.probabilities, self.covariances + spread), np.float64
        )

    def predicted(
        self,
        dt: float,
        acceleration: tuple[float, float],
        yaw_acceleration: tuple[float, float],
        axis: Float64Array | None,
    ) -> ObstacleMotion:
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
        covs = np.einsum("fm,fij->mij", weights, self.covariances)
        covs += np.einsum("fm,mfi,mfj->mij", weights, gap, gap)
        means = np.empty_like(mixed)
        out = np.empty_like(covs)
        for mode in (0, 1):
            means[mode], F = _turned(mixed[mode], dt)
            out[mode] = F @ covs[mode] @ F.T
            _add_noise(out[mode], dt, acceleration[mode], yaw_acceleration[mode], axis)
        return ObstacleMotion(means, out, probabilities)

    def updated(self, measured: Float64Array, noise: Float64Array) -> ObstacleMotion:
        """After measuring position and yaw (4,) with covariance (4, 4)."""
        means, covs = self.means.copy(), self.covariances.copy()
        likelihood = np.zeros(2)
        for mode in (0, 1):
            P = covs[mode]
            S = P[np.ix_(MEASURED, MEASURED)] + noise
            innovation = measured - means[mode, MEASURED]
            gain = np.linalg.solve(S, P[MEASURED]).T
            means[mode] += gain @ innovation
            left = np.eye(STATE_SIZE)
            left[:, MEASURED] -= gain
            covs[mode] = left @ P @ left.T + gain @ noise @ gain.T
            _, log_det = np.linalg.slogdet(S)
            likelihood[mode] = -0.5 * (innovation @ np.linalg.solve(S, innovation) + log_det)
        weight = self.probabilities * np.exp(likelihood - likelihood.max())
        weight = np.maximum(weight / weight.sum(), 1e-3)
        return ObstacleMotion(means, covs, weight / weight.sum())

    def rebased(self, offset: Float64Array) -> ObstacleMotion:
        """The same motion, told of another point of the body as its origin.

        Args:
            offset: (3,) metres, the body's frame, from the old origin to the new one.
        """
        means, covs = self.means.copy(), self.covariances.copy()
        for mode in (0, 1):
            rate = means[mode, YAW_RATE]
            arm = yaw_matrix(means[mode, YAW]) @ offset
            swing = turning_velocity(1.0, arm)
            means[mode, POSITION] += arm
            means[mode, VELOCITY] += rate * swing
            J = np.eye(STATE_SIZE)
            J[POSITION, YAW] = swing
            J[VELOCITY, YAW] = rate * turning_velocity(1.0, swing)
            J[VELOCITY, YAW_RATE] = swing
            covs[mode] = J @ covs[mode] @ J.T
        return ObstacleMotion(means, covs, self.probabilities)


def turning_velocity(yaw_rate: float, arm: Float64Array) -> Float64Array:
    """(..., 3) m/s of a point at the arm (..., 3) m of a body that turns about the vertical y."""
    arm = np.asarray(arm, dtype=np.float64)
    return yaw_rate * np.stack([arm[..., 2], np.zeros_like(arm[..., 1]), -arm[..., 0]], axis=-1)


def yaw_matrix(yaw: float) -> Float64Array:
    """(3, 3) rotation about the y axis: positive turns z towards x, to the right."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _turned(mean: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
    """The state after ``dt`` on a circle, and the derivative (8, 8) by the state before."""
    R, half = yaw_matrix(mean[YAW_RATE] * dt), yaw_matrix(mean[YAW_RATE] * dt / 2)
    v = mean[VELOCITY]
    out = mean.copy()
    out[POSITION] += dt * half @ v
    out[VELOCITY] = R @ v
    out[YAW] += dt * mean[YAW_RATE]
    F = np.eye(STATE_SIZE)
    F[POSITION, VELOCITY] = dt * half
    F[POSITION, YAW_RATE] = dt * dt / 2 * turning_velocity(1.0, half @ v)
    F[VELOCITY, VELOCITY] = R
    F[VELOCITY, YAW_RATE] = dt * turning_velocity(1.0, R @ v)
    F[YAW, YAW_RATE] = dt
    return out, F


def _add_noise(
    cov: Float64Array,
    dt: float,
    acceleration: float,
    yaw_acceleration: float,
    axis: Float64Array | None,
) -> None:
    spread = acceleration**2 * np.eye(3)
    if axis is not None:
        along = np.outer(axis, axis)
        spread = acceleration**2 * (along + _SIDEWAYS**2 * (np.eye(3) - along))
    cov[POSITION, POSITION] += dt**4 / 4 * spread
    cov[POSITION, VELOCITY] += dt**3 / 2 * spread
    cov[VELOCITY, POSITION] += dt**3 / 2 * spread
    cov[VELOCITY, VELOCITY] += dt**2 * spread
    block = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    cov[np.ix_([YAW, YAW_RATE], [YAW, YAW_RATE])] += yaw_acceleration**2 * block
