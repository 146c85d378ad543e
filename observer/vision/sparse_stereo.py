"""Disparity where it is needed only: a coarse search along the row for new points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.row_search import search_rows
from observer.parameters import StereoParameters
from observer.types import Image

# The search works at half the resolution; Lucas-Kanade finds the rest.
_REDUCTION = 2
# Side of the compared blocks, in the smaller images.
_BLOCK_PX = 9
# Gradients are compared rather than grey levels, for the cameras' brightness differs; steeper
# ones than this count alike, so that one edge does not outvote the rest (as OpenCV's StereoBM).
_CAP = 31
# The best disparity must cost this share less than any but its neighbours.
_UNIQUENESS = np.float32(0.1)
# And so many grey levels per pixel less: of repetitions that match alike, noise makes one the best.
_LEAST_GAP = 0.5


def coarse_disparity(
    left: Image, right: Image, px: NDArray[np.float32], parameters: StereoParameters
) -> NDArray[np.float32]:
    """Disparity (N,) of points (N, 2) to within about a pixel, NaN where unknown.

    The block around each point is compared with all those on its row of the right image, up to
    ``max_disparity_px``: the sum of absolute differences of the horizontal gradient, least and
    unique (block matching as in Konolige: Small Vision Systems, ISRR 1997, at the points only).

    Args:
        left, right: (H, W) grey, rectified.
        px: pixels of the left image.
    """
    if len(px) == 0:
        return np.zeros(0, np.float32)
    count = -(-parameters.max_disparity_px // _REDUCTION)
    half = _BLOCK_PX // 2
    # Points near the left border may well be seen by both; what lies outside costs its difference.
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
    """(h, w) capped horizontal gradients of the smaller image, with borders of so many pixels."""
    small = cv2.pyrDown(image)
    steep = cv2.Sobel(small, cv2.CV_8U, 1, 0, delta=_CAP)
    _, capped = cv2.threshold(steep, 2 * _CAP, 0, cv2.THRESH_TRUNC)
    return np.asarray(
        cv2.copyMakeBorder(capped, border, border, left, border, cv2.BORDER_REPLICATE), np.uint8
    )
