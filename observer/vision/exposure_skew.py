"""Unknown exposure skew between free-running cameras, estimated from static points.

If the right camera exposes later by tau, a point with flow u' along the row seems to have the
disparity ``d - tau u'``. While the camera turns at a constant rate this looks like any other
scene; when the turn begins or ends, all disparities change by ``-tau`` times the change of u'. Over
a frame, static points show it by

    Delta d = c (1 + x^2) + alpha d^2 + beta x d + gamma y d,    c = -tau Delta u'

where alpha, beta and gamma absorb the camera's own motion. The flow at a frame is interpolated from
the intervals before and after it, so every frame is evaluated one frame late.

What remains of the camera's motion, and what moves unnoticed, changes c from frame to frame, too,
slowly. A constant part is estimated beside tau, and the uncertainty grows with what is left over:
by its variance, and, as errors that last average out slowly, by ``(1 + r) / (1 - r)`` with the
correlation r of consecutive frames (Bartlett's variance of the mean of a first-order process).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

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
# Below this share of its largest possible value the determinant tells no skew from a constant;
# largest correlation that is assumed.
_SINGULAR, _MOST_CORRELATED = 1e-9, 0.9


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


@dataclass(frozen=True, eq=False)
class ExposureSkew:
    """Estimate so far of the time by which the right camera exposes later.

    Attributes:
        frames: number of frames, those long ago counting less.
        sums: (3, 3), of ``v v^T`` over the frames, where v is (c, Delta u', 1) divided by one
            standard deviation of c. lagged: of ``v w^T``, where w is v of the frame before.
        last: (3,) the newest v; None if the next frame does not follow it.
        recent: the last two frames, older first; None for a frame without a fit.
    """

    frames: float = 0.0
    sums: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    lagged: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    last: Float64Array | None = None
    recent: tuple[DisparityStep | None, DisparityStep | None] = (None, None)

    def after(self, step: DisparityStep | None) -> ExposureSkew:
        """Add one more frame, with which the frame before it can be evaluated."""
        first, middle = self.recent
        if first is None or middle is None or step is None:
            return replace(self, last=None, recent=(middle, step))
        change = _between(middle, step) - _between(first, middle)
        bend = _BEND * abs(step.flow_px_s - 2 * middle.flow_px_s + first.flow_px_s)
        sigma = math.hypot(middle.sigma_px, _BEND_SKEW_S * bend)
        seen = np.array([middle.constant_px, change, 1.0]) / sigma
        before = np.zeros(3) if self.last is None else self.last
        keep = math.exp(-step.dt / _MEMORY_S)
        return ExposureSkew(
            frames=keep * self.frames + 1,
            sums=keep * self.sums + np.outer(seen, seen),
            lagged=keep * self.lagged + np.outer(seen, before),
            last=seen,
            recent=(middle, step),
        )

    def interrupted(self) -> ExposureSkew:
        """Return the same estimate for when the next frame does not follow the last one."""
        return replace(self, last=None, recent=(None, None))

    @cached_property
    def _fit(self) -> tuple[float, float]:
        """Seconds of skew, and one standard deviation; 0 and infinity while unknown."""
        normal = self.sums[1:, 1:]
        determinant = float(np.linalg.det(normal))
        if determinant <= _SINGULAR * float(normal[0, 0] * normal[1, 1]):
            return 0.0, math.inf
        slope, constant = np.linalg.solve(normal, self.sums[1:, 0])
        left_over = np.array([1.0, -slope, -constant])
        squares = float(left_over @ self.sums @ left_over)
        products = float(left_over @ self.lagged @ left_over)
        scatter = max(1.0, squares / max(1.0, self.frames - 2))
        correlation = min(max(0.0, products / squares), _MOST_CORRELATED) if squares > 0 else 0.0
        lasting = (1 + correlation) / (1 - correlation)
        variance = float(normal[1, 1]) / determinant * scatter * lasting
        return -float(slope), math.sqrt(variance)

    @property
    def skew_s(self) -> float:
        """Seconds by which the right camera exposes later; 0 while unknown."""
        return self._fit[0]

    @property
    def sigma_s(self) -> float:
        """One standard deviation of it; infinite while unknown."""
        return self._fit[1]

    @property
    def sure(self) -> bool:
        """Return whether the skew is known well and significantly differs from zero."""
        return self.sigma_s < _KNOWN_S and abs(self.skew_s) > _SURE_SIGMAS * self.sigma_s


def _between(before: DisparityStep, after: DisparityStep) -> float:
    """Return the flow at the frame between two frame intervals, px/s."""
    span = before.dt + after.dt
    return (before.flow_px_s * after.dt + after.flow_px_s * before.dt) / span
