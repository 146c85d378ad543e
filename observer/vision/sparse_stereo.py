"""Disparity only where it is needed: a coarse search along the row for new points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.row_search import search_rows
from observer.parameters import StereoParameters
from observer.types import Image

# The search works at half the resolution; Lucas-Kanade refines the result.
_REDUCTION = 2
# Side of the compared blocks, in the reduced images.
_BLOCK_PX = 9
# Gradients are compared rather than grey levels, because the cameras' brightness differs; they are
# capped at this, so that one edge does not outvote the rest (as in OpenCV's StereoBM).
_CAP = 31
# The best disparity must cost this share less than all but its neighbours,
_UNIQUENESS = np.float32(0.1)
# and this many grey levels per pixel less: among equal repetitions, noise would pick one.
_LEAST_GAP = 0.5


def coarse_disparity(
    left: Image, right: Image, px: NDArray[np.float32], parameters: StereoParameters
) -> NDArray[np.float32]:
    """Return the disparity (N,) of points (N, 2) to within about a pixel, NaN where unknown.

    The block around each point is compared with all blocks on its row of the right image, up to
    ``max_disparity_px``. The match has the least sum of absolute differences of the horizontal
    gradient, and must be unique (block matching as in Konolige: Small Vision Systems, ISRR 1997,
    at the points only).

    Args:
        left, right: (H, W) grey, rectified.
        px: pixels of the left image.
    """
    if len(px) == 0:
        return np.zeros(0, np.float32)
    count = -(-parameters.max_disparity_px // _REDUCTION)
    half = _BLOCK_PX // 2
    # Points near the left border may be seen by both; outside the image the border is replicated.
    first = _gradients(left, half, half)
    second = _gradients(right, half, half + count)
    return search_rows(
        first,
        second,
        np.ascontiguousarray(px, np.float32),
        _REDUCTION,
        _BLOCK_PX,
        count,
        _UNIQUENESS,
        np.float32(_LEAST_GAP * _BLOCK_PX**2),
    )


def _gradients(image: Image, border: int, left: int) -> NDArray[np.uint8]:
    """(h, w) capped horizontal gradients of the reduced image, padded by these borders, pixels."""
    small = cv2.pyrDown(image)
    steep = cv2.Sobel(small, cv2.CV_8U, 1, 0, delta=_CAP)
    _, capped = cv2.threshold(steep, 2 * _CAP, 0, cv2.THRESH_TRUNC)
    return np.asarray(
        cv2.copyMakeBorder(capped, border, border, left, border, cv2.BORDER_REPLICATE), np.uint8
    )
