"""Unknown exposure skew between free-running cameras, estimated from static points.

If the right camera exposes later by tau, a point with flow u' along the row seems to have the
disparity ``d - tau u'``. While the camera turns at a constant rate this looks like any other
scene; when the turn begins or ends, all disparities change by ``-tau`` times the change of u'. Over
a frame, static points show it by

    Delta d = c (1 + x^2) + alpha d^2 + beta x d + gamma y d,    c = -tau Delta u'

where alpha, beta and gamma absorb the camera's own motion. The flow at a frame is interpolated from
the intervals before and after it, so every frame is evaluated one frame late.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.kernels.disparity_change import disparity_change
from observer.robust import median

_LEAST_POINTS = 30
_LEAST_DISPARITY_PX = 1.0
# Errors of points in one scene are correlated: factor on the sigma of c from the fit, and its
# minimum, pixels.
_SHARED = 2.0
_LEAST_SIGMA_PX = 0.03
# If a turn begins within a frame, the interpolated flow is uncertain by this share of its second
# difference; its effect is computed for a skew of this many seconds.
_BEND, _BEND_SKEW_S = 0.25, 0.01
# Seconds: old frames are forgotten, as free-running cameras drift apart within minutes.
_MEMORY_S = 60.0
_KNOWN_S = 0.002
_SURE_SIGMAS = 3.0


@dataclass(frozen=True)
class DisparityStep:
    """Change of the disparities over a frame.

    Attributes:
        dt: seconds. constant_px: c, and sigma_px: one standard deviation of it.
        flow_px_s: flow along the rows at the image's centre, px/s.
    """

    dt: float
    constant_px: float
    sigma_px: float
    flow_px_s: float

    @staticmethod
    def of(
        before_px: NDArray[np.floating],
        now_px: NDArray[np.floating],
        before_disparity: Float64Array,
        now_disparity: Float64Array,
        dt: float,
        camera: StereoCamera,
    ) -> DisparityStep | None:
        """Fit the change with iterated weights; None if there are too few points.

        Args:
            before_px, now_px: (N, 2) pixels, left image. before_disparity, now_disparity: (N,)
                pixels as matched, NaN unknown.
        """
        constant, sigma, flow = disparity_change(
            np.ascontiguousarray(before_px, np.float64),
            np.ascontiguousarray(now_px, np.float64),
            before_disparity,
            now_disparity,
            camera.numbers,
            _LEAST_DISPARITY_PX,
        )
        if len(flow) < _LEAST_POINTS:
            return None
        sigma = math.hypot(_SHARED * sigma, _LEAST_SIGMA_PX)
        return DisparityStep(dt, constant, sigma, median(flow) / dt)


@dataclass(frozen=True)
class ExposureSkew:
    """Estimate so far of the time by which the right camera exposes later.

    Attributes:
        information: 1/s^2, and vector: 1/s, summed over the frames.
        recent: the last two frames, older first; None for a frame without a fit.
    """

    information: float = 0.0
    vector: float = 0.0
    recent: tuple[DisparityStep | None, DisparityStep | None] = (None, None)

    def after(self, step: DisparityStep | None) -> ExposureSkew:
        """Add one more frame, with which the frame before it can be evaluated."""
        first, middle = self.recent
        recent = (middle, step)
        if first is None or middle is None or step is None:
            return ExposureSkew(self.information, self.vector, recent)
        change = _between(middle, step) - _between(first, middle)
        bend = _BEND * abs(step.flow_px_s - 2 * middle.flow_px_s + first.flow_px_s)
        sigma = math.hypot(middle.sigma_px, _BEND_SKEW_S * bend)
        keep = math.exp(-step.dt / _MEMORY_S)
        return ExposureSkew(
            keep * self.information + (change / sigma) ** 2,
            keep * self.vector - change * middle.constant_px / sigma**2,
            recent,
        )

    def interrupted(self) -> ExposureSkew:
        """Return the same estimate for when the next frame does not follow the last one."""
        return ExposureSkew(self.information, self.vector)

    @property
    def skew_s(self) -> float:
        """Seconds by which the right camera exposes later; 0 while unknown."""
        return self.vector / self.information if self.information > 0 else 0.0

    @property
    def sigma_s(self) -> float:
        """One standard deviation of it; infinite while unknown."""
        return self.information**-0.5 if self.information > 0 else math.inf

    @property
    def sure(self) -> bool:
        """Return whether the skew is known well and significantly differs from zero."""
        return self.sigma_s < _KNOWN_S and abs(self.skew_s) > _SURE_SIGMAS * self.sigma_s


def _between(before: DisparityStep, after: DisparityStep) -> float:
    """Return the flow at the frame between two frame intervals, px/s."""
    span = before.dt + after.dt
    return (before.flow_px_s * after.dt + after.flow_px_s * before.dt) / span
