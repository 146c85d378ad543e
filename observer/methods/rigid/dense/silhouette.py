"""The silhouette of a body: polygons in the image around the cells at which it is seen."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.segments import window_of

# Cells: corners nearer than this to the simplified line are left out. A slanted border runs in
# steps, whose corners are 0.71 cells off.
_TOLERANCE_CELLS = 0.75
_LEAST_CORNERS = 3


def silhouette_px(mask: NDArray[np.bool_], grid: Grid) -> tuple[Float64Array, ...]:
    """Return closed polygons (N, 2) in whole pixels of the left image, one for each part of a mask.

    The pixels on a polygon belong to the part. Holes in a part are filled.

    Args:
        mask: (h, w) the cells.
    """
    rows, columns = window_of(mask)
    r = grid.reduction
    pixels = mask[rows, columns].repeat(r, axis=0).repeat(r, axis=1).view(np.uint8)
    offset = (columns.start * r, rows.start * r)
    contours, _ = cv2.findContours(
        pixels, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=offset
    )
    simple = [cv2.approxPolyDP(each, _TOLERANCE_CELLS * r, closed=True) for each in contours]
    return tuple(
        each.reshape(-1, 2).astype(np.float64) for each in simple if len(each) >= _LEAST_CORNERS
    )
