"""Following points from one image to another by Lucas-Kanade, as matching and flow both need it."""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import FlowParameters
from observer.types import Image

# OpenCV gives the smaller eigenvalue of the mean gradient matrix in 1/1024 (grey levels/px)^2.
_EIGENVALUE_UNIT = 1024.0


def follow_points(
    first: Image,
    second: Image,
    px: NDArray[np.float32],
    parameters: FlowParameters,
    *,
    back_check: bool,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where the points of one image are in another (pyramidal Lucas-Kanade).

    A point is refused where it is lost, leaves the image, has less than ``min_texture`` in any
    direction (along a straight edge it would slide) or its surroundings differ by more than
    ``max_error``; with ``back_check`` also where following it back does not return to within
    ``back_check_px`` of the start.

    Args:
        first, second: (H, W) grey.
        px: (N, 2) pixels in the first image.

    Returns:
        (N, 2) pixels in the second image, and (N,) which of them are good.
    """
    if len(px) == 0:
        return px.copy(), np.empty(0, np.bool_)
    if parameters.match_brightness:
        second = _as_bright_as(first, second)
    end, found, error = _flow(first, second, px, parameters)
    height, width = first.shape
    good = (found > 0) & (error <= parameters.max_error)
    good &= ((end >= 0) & (end <= (width - 1, height - 1))).all(axis=1)
    if back_check:
        back, found, _ = _flow(second, first, end, parameters)
        good &= (found > 0) & (np.linalg.norm(back - px, axis=1) <= parameters.back_check_px)
    return end, np.asarray(good, dtype=np.bool_)


def _as_bright_as(first: Image, second: Image) -> Image:
    """The second image, scaled to the brightness of the first where it is not black.

    Lucas-Kanade compares grey levels, so that a light that flickers looks like motion to it.
    """
    seen = np.not_equal(second, 0).view(np.uint8)
    before, after = cv2.mean(first, seen)[0], cv2.mean(second, seen)[0]
    # Below a grey level the scaling would make the image worse by rounding.
    if min(before, after) < 1 or abs(after - before) < 1:
        return second
    return np.asarray(cv2.convertScaleAbs(second, alpha=before / after), dtype=np.uint8)


def _flow(
    first: Image, second: Image, px: NDArray[np.float32], parameters: FlowParameters
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    end, found, error = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        px,
        cast(Any, None),
        winSize=(parameters.window_px | 1, parameters.window_px | 1),
        maxLevel=parameters.pyramid_levels,
        minEigThreshold=parameters.min_texture**2 / _EIGENVALUE_UNIT,
    )
    return (
        np.asarray(end, dtype=np.float32),
        np.asarray(found, dtype=np.uint8)[:, 0],
        np.asarray(error, dtype=np.float32)[:, 0],
    )
