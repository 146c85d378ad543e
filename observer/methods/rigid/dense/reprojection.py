"""Reprojection of the cells of one frame into another frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.methods.rigid.dense.grid import Grid

Singles = NDArray[np.float32]


def reprojection(
    grid: Grid, T_other_camera: Pose
) -> tuple[Singles, Singles, Singles, Singles, Singles, int, int]:
    """Return the arguments that the kernels need to reproject cells, in their order.

    They are rays x and y, rotation, scaled translation, lens, height and width, see
    ``observer.kernels.reprojection``.

    Args:
        T_other_camera: from this frame's camera to that of the other frame.
    """
    c = grid.camera
    rotation = T_other_camera.rotation.astype(np.float32)
    # Places are divided by their depth f B / d: the ray plus the translation times d / (f B).
    translation = (T_other_camera.translation / c.fb).astype(np.float32)
    lens = np.array([c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, grid.reduction], np.float32)
    return (*grid.cell_rays, rotation, translation, lens, *grid.shape)
