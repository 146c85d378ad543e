"""Points that one camera tracks: each has a line of sight and a distribution of depth along it.

Depth is stored as inverse depth along the line of sight from the point's anchor, an earlier camera
pose. Inverse depth is nearly normally distributed, even for points at infinity (Civera, Davison,
Montiel: Inverse Depth Parametrization for Monocular SLAM, T-RO 2008).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.vision.lifecycle import NO_OBSTACLE

# Factor on the depth variance: depths come from the same poses, so their errors are correlated.
DEPTH_SHARED = 9.0


@dataclass(frozen=True, eq=False)
class RayPoints:
    """N points as of the newest frame. If static, they are at ``centre + ray / inverse``.

    Attributes:
        px: (N, 2) float32 pixels now. before_px: (N, 2) float32 in the frame before.
        sigma_px: (N,) one standard deviation of ``px``.
        centre: (N, 3) metres, world, where the camera was at the anchor. ray: (N, 3) unit
            vector, world. anchor_s: (N,) seconds since the anchor. age_s: (N,) since the first
            sighting.
        inverse: (N,) 1/m and variance: (N,) 1/m^2, of the inverse distance from the anchor.
        sightings: (N,) frames in which it was seen.
        residual: (N, 2) pixels, observed minus expected for a static point, and
            residual_cov: (N, 2, 2) px^2, as of this frame.
        moving: (N,) whether it was judged to move. obstacle: (N,) number of the obstacle it
            belongs to, or ``NO_OBSTACLE``.
    """

    px: NDArray[np.float32]
    before_px: NDArray[np.float32]
    sigma_px: Float64Array
    centre: Float64Array
    ray: Float64Array
    anchor_s: Float64Array
    age_s: Float64Array
    inverse: Float64Array
    variance: Float64Array
    sightings: NDArray[np.int64]
    residual: Float64Array
    residual_cov: Float64Array
    moving: NDArray[np.bool_]
    obstacle: NDArray[np.int64]

    @staticmethod
    def none() -> RayPoints:
        """No points at all."""
        return RayPoints.begin(
            np.zeros((0, 2), np.float32), np.zeros(3), np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        )

    @staticmethod
    def begin(
        px: NDArray[np.float32],
        centre: Float64Array,
        ray: Float64Array,
        inverse: Float64Array,
        variance: Float64Array,
    ) -> RayPoints:
        """Return points that are seen for the first time, all from one place (3,)."""
        count = len(px)
        return RayPoints(
            px=px,
            before_px=px,
            sigma_px=np.ones(count),
            centre=np.broadcast_to(centre, (count, 3)).copy(),
            ray=ray,
            anchor_s=np.zeros(count),
            age_s=np.zeros(count),
            inverse=inverse,
            variance=variance,
            sightings=np.ones(count, np.int64),
            residual=np.zeros((count, 2)),
            residual_cov=np.broadcast_to(np.eye(2), (count, 2, 2)).copy(),
            moving=np.zeros(count, np.bool_),
            obstacle=np.full(count, NO_OBSTACLE, np.int64),
        )

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) whether the depth's standard deviation is below a third of it."""
        return np.asarray(self.inverse > 3 * np.sqrt(self.variance))

    def place(self) -> Float64Array:
        """(N, 3) metres, world, if static; NaN for points not in front of their anchor."""
        inverse = np.where(self.inverse > 0, self.inverse, np.nan)
        return self.centre + self.ray / inverse[:, None]

    def take(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> RayPoints:
        """Return some of the points."""
        return self.but(**{f.name: getattr(self, f.name)[which] for f in fields(self)})

    def joined(self, other: RayPoints) -> RayPoints:
        """Return these points and then the others."""
        return self.but(
            **{
                f.name: np.concatenate([getattr(self, f.name), getattr(other, f.name)])
                for f in fields(self)
            }
        )

    def but(self, **changes: object) -> RayPoints:
        """Return the points with some attributes replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.px)
