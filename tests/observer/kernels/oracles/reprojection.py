"""Oracle of ``observer.kernels.reprojection``: the same formulas for all cells at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.methods.rigid.dense.grid import Grid

# Smaller depths, relative to that of the cell itself, count as behind the other camera.
_LEAST_DEPTH = np.float32(0.05)


@dataclass(frozen=True, eq=False)
class Reprojected:
    """Places in another frame.

    Attributes:
        disparity: (N,) px, expected there. at: (N,) index of the cell of each.
        inside: (N,) True in the image; where False, the others are undefined.
    """

    disparity: NDArray[np.float32]
    at: NDArray[np.intp]
    inside: NDArray[np.bool_]


def reproject(
    grid: Grid, T_other_camera: Pose, disparity: NDArray[np.float32], asked: NDArray[np.intp]
) -> Reprojected:
    """Return where cells ``asked`` (N,), at their disparities, lie in another frame."""
    c, r = grid.camera, grid.reduction
    R = T_other_camera.rotation.astype(np.float32)
    # Places over their depth f B / d: the ray, and the translation times d / (f B).
    t = (T_other_camera.translation / (c.fx * c.baseline)).astype(np.float32)
    x, y = (values[asked] for values in grid.cell_rays)
    X, Y, Z = (R[k, 0] * x + R[k, 1] * y + (R[k, 2] + t[k] * disparity) for k in range(3))
    ahead = Z > _LEAST_DEPTH
    Z = np.maximum(Z, _LEAST_DEPTH)
    # Rounded to the cell that holds the pixel.
    column = np.floor((np.float32(c.fx) * X / Z + np.float32(c.cx + 0.5)) / r)
    row = np.floor((np.float32(c.fy) * Y / Z + np.float32(c.cy + 0.5)) / r)
    h, w = grid.shape
    inside = ahead & (column >= 0) & (column < w) & (row >= 0) & (row < h)
    at = np.where(inside, row * w + column, np.float32(0)).astype(np.intp)
    return Reprojected(disparity / Z, at, inside)


def slack_px(disparity: NDArray[np.float32], grid: Grid) -> NDArray[np.float32]:
    """(N,) px by which disparities (N,) px that should be equal may differ."""
    return np.asarray(np.float32(0.6) * grid.column_px + np.float32(0.03) * disparity, np.float32)
