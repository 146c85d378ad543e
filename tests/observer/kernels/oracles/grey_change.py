"""Oracle of ``observer.kernels.grey_change``: the same formulas for all cells at once, by numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.methods.rigid.dense.free_space import DepthFrame
from observer.methods.rigid.dense.grid import Grid

from .reprojection import Reprojected, reproject, slack_px

# Grey values from which up, and to which down, a camera may have clipped the image.
_SATURATED, _BLACK = 250, 2


@dataclass(frozen=True, eq=False)
class Compared:
    """Cells (N,) of a frame against another one: where they lie in it and which are visible there.

    Attributes:
        alike: (N,) which of them were at the same distance.
    """

    there: Reprojected
    visible: NDArray[np.bool_]
    alike: NDArray[np.bool_]


def compared(
    grid: Grid,
    T_other_camera: Pose,
    disparity: NDArray[np.float32],
    other: DepthFrame,
    asked: NDArray[np.intp],
) -> Compared:
    """Compare cells (N,) of a frame, whose disparity is (h, w) px, with another one."""
    there = reproject(grid, T_other_camera, disparity.ravel()[asked], asked)
    covered = other.nearest.ravel()[there.at] - there.disparity
    slack = slack_px(there.disparity, grid)
    visible = there.inside & (covered <= slack)
    return Compared(there, visible, visible & (-covered <= slack))


def changed(
    now: NDArray[np.uint8],
    low: NDArray[np.uint8],
    high: NDArray[np.uint8],
    gain: np.float32,
    limit: np.float32,
) -> NDArray[np.bool_]:
    """(N,) whether grey values lie outside the former range around them, ``low`` to ``high``."""
    shown = (np.maximum(now, high) < _SATURATED) & (np.minimum(now, low) > _BLACK)
    level = now.astype(np.float32)
    return shown & (
        (level - gain * high.astype(np.float32) > limit)
        | (gain * low.astype(np.float32) - level > limit)
    )
