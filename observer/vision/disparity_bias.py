"""Constant bias of all disparities, estimated online by comparing near with far points.

A wrong vergence (and, similarly, a wrong principal point of the right camera) makes all
disparities too small by ``b g`` pixels, with ``g = 1 + x_r^2`` over the right image. The flow of
near points then implies a different translation of the camera than that of far points.
``vergence_fit`` eliminates the motion of each pair of views; here the pairs are summed by their
information.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.vision.vergence_fit import SeenTwice, distance_equation

# The weight of a pair of views halves every 40 pairs: the bias drifts as cameras warm up.
_KEEP = 0.5 ** (1 / 40)
# Errors of points in one scene are correlated: the variance is at least this many times that of
# independent errors, and one part, pixels, is common to all pairs (from simulated and real drives).
_LEAST_EXCESS = 4.0
_SHARED_PX = 0.05
_LEAST_PAIRS = 2.5
_KNOWN_PX = 0.1
_SURE_SIGMAS = 3.0


@dataclass(frozen=True)
class DisparityBias:
    """Estimate of the bias so far, pixels at the image's centre, to be added to disparities.

    Attributes:
        information: 1/px^2, and vector: 1/px, summed over the pairs of views.
        square: the sum of each pair's own ``vector^2 / information``, and pairs: their number.
    """

    information: float = 0.0
    vector: float = 0.0
    square: float = 0.0
    pairs: float = 0.0

    def with_pair(self, seen: SeenTwice, camera: StereoCamera, doubt_px: float) -> DisparityBias:
        """Add the information of a pair of views, unless too few points fit one motion.

        Args:
            doubt_px: standard deviation of an error common to all points of the pair.
        """
        equation = distance_equation(seen, camera, (self.px / camera.fx, 0.0), 1.0)
        if equation is None:
            return self
        information = float(equation.information[0, 0]) / camera.fx**2
        if not information > 0:
            return self
        share = 1 / (1 + information * doubt_px**2)
        vector = share * float(equation.vector[0]) / camera.fx
        information *= share
        return replace(
            self,
            information=_KEEP * self.information + information,
            vector=_KEEP * self.vector + vector,
            square=_KEEP * self.square + vector**2 / information,
            pairs=_KEEP * self.pairs + 1,
        )

    @property
    def px(self) -> float:
        """Correction to add to disparities at the image's centre, pixels; 0 while unknown."""
        return self.vector / self.information if self.information > 0 else 0.0

    @property
    def sigma_px(self) -> float:
        """One standard deviation of it, including the scatter between pairs."""
        if self.pairs < _LEAST_PAIRS:
            return math.inf
        excess = (self.square - self.px * self.vector) / (self.pairs - 1)
        return math.hypot(math.sqrt(max(_LEAST_EXCESS, excess) / self.information), _SHARED_PX)

    @property
    def known(self) -> bool:
        """Return whether the bias is known well, even if it is zero."""
        return self.sigma_px < _KNOWN_PX

    @property
    def sure(self) -> bool:
        """Return whether the bias is known well and significantly differs from zero."""
        return self.known and abs(self.px) > _SURE_SIGMAS * self.sigma_px


def bias_profile(
    px: NDArray[np.floating], disparity: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(N,) factor by which a bias is larger at points (N, 2) px, left image, than at the centre."""
    x = (px[:, 0] - disparity - camera.cx) / camera.fx
    return np.asarray(1 + x * x, dtype=np.float64)
