"""Odometry at an instant, from the robot's wheel reports before and after it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

from observer.types import Odometry

# Seconds for which the motion is extrapolated beyond the newest report: a frame is received
# before the report of its instant.
_ONWARD_S = 0.15
# Seconds: no odometry is interpolated between two reports further apart than this.
_LONGEST_GAP_S = 0.5


def odometry_at(history: Sequence[Sequence[float]], time: float) -> Odometry | None:
    """Interpolate between two reports; extrapolate shortly beyond the last one.

    Args:
        history: rows of time, x, y, yaw, the oldest first.
        time: on the same clock, seconds.

    Returns:
        None where the reports do not cover the instant.
    """
    if len(history) < 2:
        return None
    after = bisect_right([row[0] for row in history], time)
    if after == 0 or time - history[-1][0] > _ONWARD_S:
        return None
    after = min(after, len(history) - 1)
    a, b = history[after - 1], history[after]
    gap = b[0] - a[0]
    if not 0 < gap <= _LONGEST_GAP_S:
        return None
    share = (time - a[0]) / gap
    x, y = (a[k] + share * (b[k] - a[k]) for k in (1, 2))
    # Some robots report a yaw that jumps by a full turn.
    yaw = a[3] + share * math.remainder(b[3] - a[3], 2 * math.pi)
    if not all(math.isfinite(value) for value in (x, y, yaw)):
        return None
    return Odometry(x, y, yaw)
