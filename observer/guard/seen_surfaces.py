"""Surfaces that were seen ahead and are now too near to be measured.

Nearer than the largest disparity that is searched, a surface is not measured at all, or falsely as
farther away. The floor does not show it either if it hangs above it, as a table top does, and sonar
passes below. So what was seen in the way stays in the way until the robot has left it behind, or
until it is seen to be gone from far enough away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import inverse, moved
from observer.guard.seen_ground import ScanView

# Metres: places nearer to each other than this are one, and a surface reaches so far around each.
_APART_M = 0.06
# Metres by which a surface's distance may differ from one scan to the next, and scans in a row in
# which it must be seen: a mismatch does not repeat itself there.
_REPEATED_M = 0.12
_REPEATS = 3
# Metres farther than the nearest measurable distance up to which surfaces are remembered.
_REACH_M = 0.5


class RememberedSurfaces:
    """Places of surfaces around one robot, (N, 2) metres in its current base frame."""

    def __init__(self) -> None:
        self._places = np.zeros((0, 2))
        # Of the last scan, and in how many in a row each has been seen.
        self._newest = np.zeros((0, 2))
        self._repeats = np.zeros(0, np.intp)

    def carry(self, step: Float64Array) -> None:
        """Follow a motion of the robot: the pose (3,) of its base now, in its base frame before."""
        back = np.array(inverse(step))
        self._places, self._newest = moved(self._places, back), moved(self._newest, back)

    def see(self, view: ScanView, then: Float64Array) -> None:
        """Take in a scan, made when the robot's base now had the pose (3,) ``then``."""
        known, before = moved(self._places, then), moved(self._newest, then)
        known = known[~view.shows_gone(known)]
        seen = view.surfaces(_REACH_M)
        near = _distances(seen, before) <= _REPEATED_M
        repeats = 1 + np.where(near, self._repeats, 0).max(axis=1, initial=0)
        certain = seen[repeats >= _REPEATS]
        new = certain[(_distances(certain, known) > _APART_M).all(axis=1)]
        known = np.concatenate([known, new])
        # What is farther away is seen again before the robot can reach it.
        known = known[np.hypot(*known.T) <= view.farthest_blind_m + _REACH_M]
        back = np.array(inverse(then))
        self._places, self._newest = moved(known, back), moved(seen, back)
        self._repeats = np.asarray(repeats, np.intp)

    def at(self, points: Float64Array) -> NDArray[np.bool_]:
        """Return at which points (N, 2) of the current base frame there is a surface."""
        return np.asarray((_distances(points, self._places) <= _APART_M).any(axis=1), np.bool_)


def _distances(points: Float64Array, others: Float64Array) -> Float64Array:
    """(N, M) metres between points (N, 2) and others (M, 2)."""
    apart = points[:, None] - others
    return np.asarray(np.hypot(apart[..., 0], apart[..., 1]))
