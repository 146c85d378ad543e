"""Cause of few matches in a pair: left and right swapped, or rows too far apart."""

from __future__ import annotations

import cv2
import numpy as np

from observer.types import Image
from observer.vision.stereo import FIXED_POINT
from observer.vision.swapped import swapped_sentence

# Both orders take 2 ms at this size; a larger image is reduced to it.
_PIXELS = 32768
_LEAST_SHRINK = 2.0
_BLOCK_PX = 15
_UNIQUENESS_PERCENT = 15
_TEXTURE = 200
# In the right order 31 to 68 % of the pixels find a partner, in the wrong one 0 to 19 %, and at
# least 3.1 times as many in the right order in every single pair.
_LEAST_SUPPORT = 0.15
_SWAP_RATIO = 2.0
# Row shifts tried, in rows of the reduced images, each two pixels or more. With correct rows, a
# shift by one row finds at most 0.92 times as many partners; by 4 px, 0.7.
_MOST_ROWS, _ROWS_RATIO = 8, 1.15


def mismatch_reason(left: Image, right: Image, max_disparity_px: int) -> str | None:
    """Check why so little of a pair matches: left and right swapped, or rows far apart.

    Runs block matching on the pair as it is, in the other order, and with the right image shifted
    by whole rows. In the wrong order there are no true matches at positive disparities;
    disparities below one pixel, where the order makes no difference, do not count. Takes 2 ms at
    512x256 for each of at most 18 matchings, so call it only now and then while stereo finds
    little.

    Args:
        left, right: (H, W) grey, rectified. max_disparity_px: as of the stereo stage.
    """
    shrink = max(_LEAST_SHRINK, (left.size / _PIXELS) ** 0.5)
    size = (max(1, round(left.shape[1] / shrink)), max(1, round(left.shape[0] / shrink)))
    # At most a quarter of the width, so that half of it can be tested in both orders.
    count = min(-(-int(max_disparity_px / shrink) // 16), size[0] // 64) * 16
    if count == 0 or size[1] <= _BLOCK_PX + 2 * _MOST_ROWS:
        return None
    small_left, small_right = (
        np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        for image in (left, right)
    )
    as_given = _support(small_left, small_right, count)
    swapped = _support(small_right, small_left, count)
    if swapped >= max(_LEAST_SUPPORT, _SWAP_RATIO * as_given):
        return swapped_sentence(swapped, as_given)
    shifts = [rows for rows in range(-_MOST_ROWS, _MOST_ROWS + 1) if rows]
    shifted = [_support(*_shifted(small_left, small_right, rows), count) for rows in shifts]
    best = int(np.argmax(shifted))
    if shifted[best] >= max(_LEAST_SUPPORT, _ROWS_RATIO * as_given):
        return (
            f"the epipolar error is about {abs(shifts[best]) * shrink:.0f} px: "
            f"{100 * shifted[best]:.0f} % of the image has a stereo match there and "
            f"{100 * as_given:.0f} % in its own row; recalibrate"
        )
    return None


def _shifted(left: Image, right: Image, rows: int) -> tuple[Image, Image]:
    """Return the parts of both images in which row v of one is row v + rows of the other."""
    height = left.shape[0]
    return (
        np.ascontiguousarray(left[max(0, -rows) : height - max(0, rows)]),
        np.ascontiguousarray(right[max(0, rows) : height - max(0, -rows)]),
    )


def _support(left: Image, right: Image, count: int) -> float:
    """Return the share of pixels, 0 to 1, with a match at 1 to ``count`` pixels of disparity."""
    matcher = cv2.StereoBM.create(count, _BLOCK_PX)
    matcher.setUniquenessRatio(_UNIQUENESS_PERCENT)
    matcher.setTextureThreshold(_TEXTURE)
    matcher.setDisp12MaxDiff(1)
    fixed = np.asarray(matcher.compute(left, right))[:, count : left.shape[1] - count]
    return float(np.count_nonzero(fixed >= FIXED_POINT) / fixed.size)
