"""Reprojection of the place shown by a cell of one frame into another frame."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import (
    Singles,
    part,
)

# Depths below this, relative to the depth in the cell's own frame, count as behind the camera.
_LEAST_DEPTH = np.float32(0.05)


@part
def cell_there(
    x: np.float32,
    y: np.float32,
    disparity: np.float32,
    R: Singles,
    t: Singles,
    lens: Singles,
    height: int,
    width: int,
) -> tuple[int, np.float32]:
    """Return the index of the other frame's cell that shows a place, and its disparity there, px.

    The index is -1 if the place is outside the other image or behind its camera.

    Args:
        x, y: of the ray (x, y, 1) to the place. disparity: px, of the place.
        R: (3, 3) and t: (3,) from this frame's camera to the other's; the translation in metres
            over f B, so that multiplied by the disparity it is relative to the place's depth.
        lens: (5,) focal lengths; principal point plus half a pixel; pixels per cell.
        height, width: of both frames, in cells.
    """
    Z = R[2, 0] * x + R[2, 1] * y + (R[2, 2] + t[2] * disparity)
    if not Z > _LEAST_DEPTH:
        return -1, disparity
    X = R[0, 0] * x + R[0, 1] * y + (R[0, 2] + t[0] * disparity)
    Y = R[1, 0] * x + R[1, 1] * y + (R[1, 2] + t[1] * disparity)
    # The cell that holds the pixel.
    column = (lens[0] * X / Z + lens[2]) / lens[4]
    row = (lens[1] * Y / Z + lens[3]) / lens[4]
    if not (column >= 0 and column < width and row >= 0 and row < height):
        return -1, disparity
    return int(row) * width + int(column), disparity / Z
