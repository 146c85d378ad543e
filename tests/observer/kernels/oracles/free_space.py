"""Oracle of ``observer.kernels.free_space``: the same formulas for all cells at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED, UNKNOWN, DepthFrame
from observer.methods.rigid.dense.grid import Grid

from .reprojection import reproject, slack_px


def against(
    grid: Grid,
    T_other_camera: Pose,
    disparity: NDArray[np.float32],
    reference: DepthFrame,
    asked: NDArray[np.intp],
) -> NDArray[np.uint8]:
    """(N,) evidence of cells (N,) of a frame (h, w) px, by one earlier frame."""
    there = reproject(grid, T_other_camera, disparity.ravel()[asked], asked)
    seen = there.inside & (reference.disparity.ravel()[there.at] > 0)
    slack = slack_px(there.disparity, grid)
    out = np.full(len(asked), STATIC, np.uint8)
    out[there.disparity - reference.nearest.ravel()[there.at] > slack] = ARRIVED
    out[there.disparity - reference.farthest.ravel()[there.at] < -slack] = UNCOVERED
    out[~seen] = UNKNOWN
    return out
