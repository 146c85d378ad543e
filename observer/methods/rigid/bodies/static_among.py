"""Static points among those of a tentative track: a rigid body hides what is behind it.

Where a pattern is seen through another, as hedges through a fence, points stick to neither and seem
to move. Their neighbours, which do not, show that nothing is there that moves as a whole.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.chi_square import quantile
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

# Members from which the area between them is a part of a body.
_LEAST_MEMBERS = 6
# Static points among them, and their least share of the members. Of bodies that do move, at most
# one in twelve; of points in front of hedges and fences one in six or more.
_LEAST_STATIC, _STATIC_SHARE = 3, 0.12
# Pixels, and share of the disparity, beyond the disparities of most members that a point may be
# off; and the quantiles of these.
_BEYOND_PX, _BEYOND_SHARE, _MOST = 1.0, 0.05, (0.1, 0.9)
# A static point's own velocity fits rest, and surely not that of the body.
_FITS_CHI2, _DIFFERS_CHI2 = quantile(0.95, df=3), quantile(0.99, df=3)


def note_static_points(
    tracks: list[BodyTrack], points: TrackedPoints, motion: PooledMotion
) -> None:
    """Note which tentative tracks have static points among their own.

    Args:
        points: with the bodies they belong to. motion: how they move.
    """
    for track in [t for t in tracks if t.state is TrackState.TENTATIVE]:
        track.among_static = False
        mine = np.flatnonzero((points.obstacle == track.id) & np.isfinite(points.disparity))
        if not track.rigid or len(mine) < _LEAST_MEMBERS:
            continue
        low, high = np.quantile(points.disparity[mine], _MOST)
        beyond = min(_BEYOND_PX, _BEYOND_SHARE * low)
        free = (points.within == NO_OBSTACLE) | (points.within == track.id)
        others = (points.obstacle == NO_OBSTACLE) & free & motion.judged
        others &= (points.disparity >= low - beyond) & (points.disparity <= high + beyond)
        among = np.flatnonzero(others)
        among = among[_between(points.px[among], points.px[mine])]
        velocity, information = motion.own_velocity[among], motion.own_information[among]
        gap = velocity - track.mean[VELOCITY]
        rest = np.einsum("ni,nij,nj->n", velocity, information, velocity)
        body = np.einsum("ni,nij,nj->n", gap, information, gap)
        count = np.count_nonzero((rest < _FITS_CHI2) & (body > _DIFFERS_CHI2))
        track.among_static = bool(count >= max(_LEAST_STATIC, _STATIC_SHARE * len(mine)))


def _between(px: NDArray[np.float32], around: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) which pixels (N, 2) lie inside the convex hull of others (M, 2)."""
    corners = cv2.convexHull(around)[:, 0]
    sides = np.roll(corners, -1, axis=0) - corners
    to = px[:, None] - corners
    turn = sides[:, 0] * to[..., 1] - sides[:, 1] * to[..., 0]
    return np.asarray((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1))
