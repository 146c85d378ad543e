"""Sonar over a floor: the nearest surface in each cone, assuming that everything echoes."""

from __future__ import annotations

import math

import numpy as np

from observer.geometry import Float64Array
from observer.robots.models import SonarPose
from observer.simulation.motion import PlanarState

REACH_M = 5.0
# A real sonar cannot distinguish nearer echoes from its own pulse.
NEAREST_M = 0.05
HALF_CONE_RAD = math.radians(15)


def sonar_range(edges: Float64Array, vehicle: PlanarState, sonar: SonarPose) -> float | None:
    """Return the distance in metres to the nearest edge in a sonar's cone; None beyond its reach.

    Args:
        edges: (N, 4) float64, x and y of both ends, metres, in the frame of ``vehicle``.

    The result is exact: every edge is clipped to the cone and its nearest point taken.
    """
    if not len(edges):
        return None
    c, s = math.cos(vehicle.heading), math.sin(vehicle.heading)
    x, y = vehicle.x + c * sonar.x - s * sonar.y, vehicle.y + s * sonar.x + c * sonar.y
    axis = vehicle.heading + sonar.heading
    c, s = math.cos(axis), math.sin(axis)
    ends = edges.reshape(-1, 2, 2) - (x, y)
    # In the sonar's own axes: ahead and to the left.
    ahead, left = c * ends[..., 0] + s * ends[..., 1], c * ends[..., 1] - s * ends[..., 0]
    slope = math.tan(HALF_CONE_RAD)
    # The cone is where slope * ahead - left and slope * ahead + left are both at least 0; along
    # an edge each is a linear function, so the part inside is one interval of 0 to 1.
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    for inside in (slope * ahead - left, slope * ahead + left):
        a, b = inside[:, 0], inside[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = np.where(a == b, 0.0, a / (a - b))
        low = np.where(a < 0, np.where(b < 0, 2.0, np.maximum(low, cross)), low)
        high = np.where((b < 0) & (a >= 0), np.minimum(high, cross), high)
    seen = low <= high
    if not seen.any():
        return None
    start = np.stack([ahead[seen, 0], left[seen, 0]], axis=1)
    along = np.stack([ahead[seen, 1], left[seen, 1]], axis=1) - start
    length2 = np.maximum((along**2).sum(axis=1), 1e-18)
    nearest = np.clip(-(start * along).sum(axis=1) / length2, low[seen], high[seen])
    distance = float(np.hypot(*(start + nearest[:, None] * along).T).min())
    return None if distance > REACH_M else max(distance, NEAREST_M)
