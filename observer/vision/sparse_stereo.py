"""Disparity where it is needed only: a coarse search along the row for new points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import StereoParameters
from observer.types import Image

# The search works at half the resolution; Lucas-Kanade finds the rest.
_REDUCTION = 2
# Side of the compared blocks, in the smaller images.
_BLOCK_PX = 9
# Gradients are compared rather than grey levels, for the cameras' brightness differs; steeper
# ones than this count alike, so that one edge does not outvote the rest (as OpenCV's StereoBM).
_CAP = 31
# A byte holds the sum of so many differences of capped gradients.
_BYTES = 255 // (2 * _CAP)
# The best disparity must cost this share less than any but its neighbours.
_UNIQUENESS = 0.1
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
    column = np.rint(px[:, 0] / _REDUCTION).astype(np.intp)
    row = np.rint(px[:, 1] / _REDUCTION).astype(np.intp)
    column = np.minimum(column, first.shape[1] - _BLOCK_PX)
    row = np.minimum(row, first.shape[0] - _BLOCK_PX)
    block = _windows(first, row, column, _BLOCK_PX)
    # Number d of the strip's blocks has the disparity count - d.
    strip = _windows(second, row, column, _BLOCK_PX + count)
    cost = np.zeros((count + 1, len(px)), np.uint16)
    for x in range(_BLOCK_PX):
        a, b = block[:, x, None], strip[:, x : x + count + 1]
        apart = np.maximum(a, b)
        apart -= np.minimum(a, b)
        # By bytes as far as they hold the sum: twice as many at once.
        for begin in range(0, _BLOCK_PX, _BYTES):
            part = apart[begin]
            for more in apart[begin + 1 : begin + _BYTES]:
                part += more
            cost += part
    return _best(np.ascontiguousarray(cost.T), px[:, 0])


def _windows(
    image: NDArray[np.uint8], row: NDArray[np.intp], column: NDArray[np.intp], width: int
) -> NDArray[np.uint8]:
    """(height of a block, width, N): what lies right of and below N pixels."""
    every = np.lib.stride_tricks.sliding_window_view(image, (_BLOCK_PX, width))
    # The same pixel of all points side by side, for this is how they are compared.
    return np.ascontiguousarray(every[row, column].transpose(1, 2, 0))


def _gradients(image: Image, border: int, left: int) -> NDArray[np.uint8]:
    """(h, w) capped horizontal gradients of the smaller image, with borders of so many pixels."""
    small = cv2.pyrDown(image)
    steep = cv2.Sobel(small, cv2.CV_8U, 1, 0, delta=_CAP)
    capped = np.minimum(steep, 2 * _CAP)
    return np.asarray(
        cv2.copyMakeBorder(capped, border, border, left, border, cv2.BORDER_REPLICATE), np.uint8
    )


def _best(cost: NDArray[np.uint16], u: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N,) px disparity of least cost (N, D), by a parabola; NaN if not unique or outside.

    Args:
        cost: of the disparities D - 1, ..., 0 in the smaller image.
        u: (N,) px column of each point.
    """
    number, last = np.arange(len(cost)), cost.shape[1] - 1
    best = np.argmin(cost, axis=1)
    least = cost[number, best].astype(np.float32)
    others = cost.copy()
    for offset in (-1, 0, 1):
        others[number, np.clip(best + offset, 0, last)] = np.iinfo(np.uint16).max
    second = others.min(axis=1).astype(np.float32)
    unique = second - least >= np.maximum(_UNIQUENESS * second, _LEAST_GAP * _BLOCK_PX**2)
    before = cost[number, np.maximum(best - 1, 0)].astype(np.float32)
    after = cost[number, np.minimum(best + 1, last)].astype(np.float32)
    bend = np.maximum(before + after - 2 * least, 1)
    between = np.clip((before - after) / (2 * bend), -0.5, 0.5)
    # The first and the last have a neighbour on one side only, and no parabola.
    between[(best == 0) | (best == last)] = 0
    disparity = _REDUCTION * (last - best - between)
    return np.where(unique & (disparity <= u), disparity, np.nan).astype(np.float32)
