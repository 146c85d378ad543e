"""Distance of the trunk of a body with limbs, by the points that are tracked on it.

A point on a trunk stays as far before or behind the body's origin as it was. The change it measures
between two frames has only its noise as error, wherever on the trunk it lies, so even a few points
measure motion along the line of sight ten times better than the depth of the whole outline does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.trunk_shift import trunk_shift
from observer.methods.rigid.bodies.filter import POSITION, BodyFilter
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

# Fewer points may all be on an arm.
_LEAST_POINTS = 3
# Metres, one standard deviation: a trunk twists and sways; and across the line of sight, where
# nothing is measured.
_SWAY_M, _UNKNOWN_M = 0.007, 10.0
# Seconds, time constant with which a point's place on the trunk follows its sightings.
_MEMORY_S = 1.0
_EYE = np.eye(3)
# Squared Mahalanobis length above which a measurement counts less: it is that of a limb.
_FAR_CHI2 = 9.0


@dataclass(eq=False)
class TrunkDepths:
    """Points on one trunk, and where they are relative to the body's origin.

    Attributes:
        number: (N,) of each point. offset: (N, 3) metres, world axes. variance: (N,) m^2, along
            the line of sight. measured: enough of them were seen to tell how far away the body is.
    """

    number: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    offset: Float64Array = field(default_factory=lambda: np.zeros((0, 3)))
    variance: Float64Array = field(default_factory=lambda: np.zeros(0))
    measured: bool = False

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
        place, number = sightings.position[on_trunk], points.number[on_trunk]
        variance, before, moved, moved_variance = trunk_shift(
            number, place, sightings.information[on_trunk], motion.mean[POSITION], ahead,
            self.number, self.offset, self.variance, _LEAST_POINTS,
        )  # fmt: skip
        self.measured = math.isfinite(moved_variance)
        if self.measured:
            motion = _moved(motion, ahead, moved, moved_variance + _SWAY_M**2)
        offset, doubt = place - motion.mean[POSITION], variance.copy()
        stay = np.flatnonzero(before >= 0)
        kept = before[stay]
        gain = min(1.0, dt / _MEMORY_S)
        offset[stay] = self.offset[kept] + gain * (offset[stay] - self.offset[kept])
        doubt[stay] = (1 - gain) ** 2 * self.variance[kept] + gain**2 * variance[stay]
        self.number, self.offset, self.variance = number, offset, doubt
        return motion


def _moved(motion: BodyFilter, ahead: Float64Array, moved: float, variance: float) -> BodyFilter:
    """Return the motion of a body that is ``moved`` metres farther away than expected."""
    expected = float(ahead @ motion.covariance[POSITION, POSITION] @ ahead) + variance
    doubt = max(1.0, moved**2 / expected / _FAR_CHI2)
    along = ahead[:, None] * ahead
    noise = along * (variance * doubt**2) + (_EYE - along) * _UNKNOWN_M**2
    return motion.with_position(motion.mean[POSITION] + ahead * moved, noise)
