"""How far away the trunk of a body with limbs is, by the points that are followed on it.

A point on a trunk stays as far before or behind the body's origin as it was. What it tells in two
frames differs by its noise alone, not by where on the trunk it lies, so that even a few of them
tell the motion along the line of sight ten times better than the depth of the whole outline does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, inverse_3x3
from observer.methods.rigid.bodies.filter import POSITION, BodyFilter
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.robust import MAD_TO_SIGMA, median

# Fewer points may all be on an arm.
_LEAST_POINTS = 3
# Metres, one standard deviation: a trunk twists and sways; and across, where nothing is measured.
_SWAY_M, _UNKNOWN_M = 0.007, 10.0
# Where a point is on the trunk follows what is seen within so many seconds.
_MEMORY_S = 1.0
# Robust mean: weights fall from so many deviations on, and a point that is farther off has another
# place from now on. The noise of points on one body is alike by this share.
_FULL_SIGMAS, _LEAVE_SIGMAS = 2.0, 4.0
_STEPS = 3
# Most of a sighting's error the same point repeats in the next frame: two differ by less.
_LEAST_SCALE = 0.3
_CORRELATED = 0.1
# Squared length from which on a measurement is doubted: it is that of a limb.
_FAR_CHI2 = 9.0


@dataclass(eq=False)
class TrunkDepths:
    """Points on one trunk, and where they are about the body's origin.

    Attributes:
        number: (N,) of each point. offset: (N, 3) metres, world axes. variance: (N,) m^2, along
            the line of sight. tell: enough of them were seen to tell where the body is.
    """

    number: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    offset: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    variance: Float64Array = field(default_factory=lambda: np.zeros(0))
    tell: bool = False

    def measure(
        self,
        motion: BodyFilter,
        on_trunk: NDArray[np.intp],
        points: TrackedPoints,
        sightings: WorldSightings,
        scene: DenseScene,
        dt: float,
    ) -> BodyFilter:
        """Return a body's motion, moved along the line of sight to where the points are seen.

        Args:
            on_trunk: (K,) the points that are surely on it, seen in this frame.
            dt: seconds since the frame before.
        """
        ahead = motion.mean[POSITION] - scene.T_world_camera.translation
        ahead /= np.linalg.norm(ahead)
        place = sightings.position[on_trunk]
        noise = inverse_3x3(sightings.information[on_trunk])
        variance = np.einsum("i,nij,j->n", ahead, noise, ahead)
        number = points.number[on_trunk]
        _, now, before = np.intersect1d(
            number, self.number, assume_unique=True, return_indices=True
        )
        fits = np.ones(len(now), np.bool_)
        self.tell = len(now) >= _LEAST_POINTS
        if self.tell:
            moved = (place[now] - motion.mean[POSITION] - self.offset[before]) @ ahead
            mean, mean_variance, fits = _robust_mean(moved, variance[now] + self.variance[before])
            motion = _moved(motion, ahead, mean, mean_variance + _SWAY_M**2)
        offset, doubt = place - motion.mean[POSITION], variance.copy()
        stay, kept = now[fits], before[fits]
        gain = min(1.0, dt / _MEMORY_S)
        offset[stay] = self.offset[kept] + gain * (offset[stay] - self.offset[kept])
        doubt[stay] = (1 - gain) ** 2 * self.variance[kept] + gain**2 * variance[stay]
        self.number, self.offset, self.variance = number, offset, doubt
        return motion


def _robust_mean(
    moved: Float64Array, variance: Float64Array
) -> tuple[float, float, NDArray[np.bool_]]:
    """Return the mean of (N,) metres with variances (N,), its own variance, and which fit."""
    mean = median(moved)
    for _ in range(_STEPS):
        length = np.abs(moved - mean) / np.sqrt(variance)
        scale = max(_LEAST_SCALE, median(length) * MAD_TO_SIGMA)
        fits = length <= _LEAVE_SIGMAS * scale
        weight = np.minimum(1.0, _FULL_SIGMAS * scale / np.maximum(length, 1e-9)) * fits / variance
        mean = float(weight @ moved / weight.sum())
    used = np.count_nonzero(fits)
    return mean, float(scale**2 * (1 + _CORRELATED * used) / weight.sum()), fits


def _moved(motion: BodyFilter, ahead: Float64Array, moved: float, variance: float) -> BodyFilter:
    """Return the motion of a body that is so much farther away than expected, metres."""
    expected = float(ahead @ motion.covariance[POSITION, POSITION] @ ahead) + variance
    doubt = max(1.0, moved**2 / expected / _FAR_CHI2)
    across = np.eye(3) - np.outer(ahead, ahead)
    noise = np.outer(ahead, ahead) * variance * doubt**2 + across * _UNKNOWN_M**2
    return motion.with_position(motion.mean[POSITION] + ahead * moved, noise)
