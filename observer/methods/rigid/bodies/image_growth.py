"""Growth of a body's image: what comes nearer grows, whatever its disparity says.

Far away, and on what is narrow, disparities are too uncertain to tell whether a body approaches or
recedes. The image of one at a distance z grows by -z'/z of its size per second; that of a static
one does so only because the camera drives. The flow of a body's points shows it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.methods.rigid.camera_step import CameraStep
from observer.robust import MAD_TO_SIGMA, median

# Natural logarithm of the growth beyond that of a static image that shows an approach, and standard
# deviations of it.
_LEAST_GROWTH, _SIGMAS = 0.05, 5.0
# Points that show how an image grows.
_LEAST_POINTS = 6
# Standard deviations beyond which a point's flow counts as that of a limb.
_STRAY = 3.0
# px/s: flow is never known better.
_LEAST_NOISE = 1.0


@dataclass(frozen=True)
class Growth:
    """Growth of a body's image since its track began.

    Attributes:
        beyond: natural logarithm of its ratio to that of a static image. variance: of that.
        static: by how much static images may have grown or shrunk meanwhile, as the camera drove.
    """

    beyond: float = 0.0
    variance: float = 0.0
    static: float = 0.0

    def seen(
        self, px: Float64Array, flow: Float64Array, disparity: float, now: CameraStep
    ) -> Growth:
        """Return the growth after one more frame; the same if too few points show it.

        Args:
            px: (N, 2) of points on the body, and their flow (N, 2) px/s. disparity: of the body,
                px.
        """
        if len(px) < _LEAST_POINTS:
            return self
        # As of static things that all have the body's disparity.
        static_flow = now.rate.static_flow(px, np.full(len(px), disparity), now.camera)
        rate, variance = _growth_rate(px, flow - static_flow)
        static = float(np.linalg.norm(now.rate.shift)) * disparity / now.camera.fb
        return Growth(
            self.beyond + rate * now.dt,
            self.variance + variance * now.dt**2,
            self.static + static * now.dt,
        )

    def shows(self, approach_mps: float) -> bool:
        """Return whether it shows that a body approaches; at a negative speed, that it recedes.

        A static body twice or half as far away as its disparity says grows or shrinks by no more
        than ``static`` beyond what is expected; so does one that lies slanting in the view.
        """
        growth = self.beyond if approach_mps > 0 else -self.beyond
        return growth >= max(_LEAST_GROWTH + self.static, _SIGMAS * math.sqrt(self.variance))


def _growth_rate(px: Float64Array, flow: Float64Array) -> tuple[float, float]:
    """Return by which share per second an image grows, and the variance of that.

    It is the slope of the flow over the place; limbs, which swing, are left out.

    Args:
        px: (N, 2) of its points. flow: (N, 2) px/s, beyond that of a static image.
    """
    use = np.ones(len(px), np.bool_)
    for _ in range(2):
        place, beyond = px - px[use].mean(axis=0), flow - flow[use].mean(axis=0)
        spread = max(1.0, float(np.square(place[use]).sum()))
        rate = float((place[use] * beyond[use]).sum()) / spread
        left = np.abs(beyond - rate * place).max(axis=1)
        noise = max(_LEAST_NOISE, MAD_TO_SIGMA * median(left))
        use = left <= _STRAY * noise
    return rate, noise**2 / spread
