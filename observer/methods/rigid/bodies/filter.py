"""The motion of one obstacle: place, velocity, yaw and yaw rate, steady or manoeuvring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.body_filter import mixed, predict, update

# State: position (3) m, velocity (3) m/s, yaw rad, yaw rate rad/s; world frame.
POSITION, VELOCITY = slice(0, 3), slice(3, 6)
YAW, YAW_RATE = 6, 7
STATE_SIZE = 8
# What is measured: position and yaw.
MEASURED = np.array([0, 1, 2, YAW])
_POSITION, _VELOCITY = np.arange(3), np.arange(3, 6)
# Stands for an unknown axis.
_UNKNOWN = np.zeros(3)
# rad/s, one standard deviation: yaw rate of a body whose yaw nothing shows, so small that it stays.
_STRAIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class BodyFilter:
    """An interacting-multiple-model filter with two modes (Blom and Bar-Shalom, 1988).

    Both modes are the coordinated turn: the velocity turns with the body. They differ in how
    strongly it may accelerate. Mixed, they respond quickly where the measurement is good (across
    the line of sight) and slowly where it is not (along it).

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

    @property
    def mean(self) -> Float64Array:
        """State (8,), mixed over both modes."""
        return self._mixed[0]

    @property
    def covariance(self) -> Float64Array:
        """Covariance (8, 8), mixed over both modes."""
        return self._mixed[1]

    @cached_property
    def _mixed(self) -> tuple[Float64Array, Float64Array]:
        return mixed(self.means, self.covariances, self.probabilities)

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
        """Return the state with its position shifted by (3,) metres, its velocity by (3,) m/s."""
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
        """Return the state ``dt`` seconds later.

        Args:
            acceleration: m/s^2, yaw_acceleration: rad/s^2; one standard deviation of white noise
                over a frame, steady and manoeuvring.
            axis: (3,) unit vector along which the body accelerates and brakes most, as it does on
                wheels; None if unknown. What is measured well across the line of sight then also
                tells the motion along it.
        """
        along = _UNKNOWN if axis is None else axis
        return BodyFilter(
            *predict(
                self.means, self.covariances, self.probabilities, dt, acceleration,
                yaw_acceleration, along,
            )
        )  # fmt: skip

    def updated(self, measured: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of position and yaw (4,) with covariance (4, 4)."""
        return self._updated(MEASURED, measured, noise)

    def with_position(self, position: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of the position (3,) alone, with covariance (3, 3)."""
        return self._updated(_POSITION, position, noise)

    def with_velocity(self, velocity: Float64Array, noise: Float64Array) -> BodyFilter:
        """Update by a measurement of the velocity (3,) alone, with covariance (3, 3)."""
        return self._updated(_VELOCITY, velocity, noise)

    def straightened(self) -> BodyFilter:
        """Return the same motion, but not turning: the yaw rate is 0 and almost certain."""
        means, covs = self.means.copy(), self.covariances.copy()
        means[:, YAW_RATE] = 0.0
        covs[:, YAW_RATE, :] = covs[:, :, YAW_RATE] = 0.0
        covs[:, YAW_RATE, YAW_RATE] = _STRAIGHT**2
        return BodyFilter(means, covs, self.probabilities)

    def doubted(self, velocity_cov: Float64Array) -> BodyFilter:
        """Return the same motion, its velocity less certain by a covariance (3, 3) (m/s)^2."""
        covs = self.covariances.copy()
        covs[:, VELOCITY, VELOCITY] += velocity_cov
        return BodyFilter(self.means, covs, self.probabilities)

    def _updated(
        self, which: NDArray[np.intp], measured: Float64Array, noise: Float64Array
    ) -> BodyFilter:
        """Update by a measurement (K,) of components ``which`` (K,), with covariance (K, K)."""
        return BodyFilter(
            *update(self.means, self.covariances, self.probabilities, which, measured, noise)
        )

    def rebased(self, offset: Float64Array) -> BodyFilter:
        """Return the same motion with another point of the body as its origin.

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


def turning_velocity(yaw_rate: Float64Array | float, arm: Float64Array) -> Float64Array:
    """(..., 3) m/s of a point at the arm (..., 3) m of a body that turns about the vertical y.

    Args:
        yaw_rate: rad/s; one for all, or (...) one for each arm.
    """
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
