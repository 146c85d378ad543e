"""Disparity where it is needed only: a coarse search for new points."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import StereoParameters
from observer.types import Image

_FIXED_POINT = 16.0
_BLOCK_PX = 9
_UNIQUENESS_PERCENT = 10
# A corner often lies on the edge of what is known; the nearest known neighbour will do, for
# Lucas-Kanade finds the rest.
_SEARCH = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (0, 2), (0, -2))


def coarse_disparity(
    left: Image, right: Image, px: NDArray[np.float32], parameters: StereoParameters
) -> NDArray[np.float32]:
    """Disparity (N,) of points (N, 2) to within about a pixel, NaN where unknown.

    Block matching at half the resolution; cheap enough for every frame.

    Args:
        left, right: (H, W) grey, rectified.
    """
    count = -(-parameters.max_disparity_px // 32) * 16
    small_left, small_right = cv2.pyrDown(left), cv2.pyrDown(right)
    # The matcher leaves the first columns out, although points there may well be seen by both.
    small_left = cv2.copyMakeBorder(small_left, 0, 0, count, 0, cv2.BORDER_REPLICATE)
    small_right = cv2.copyMakeBorder(small_right, 0, 0, count, 0, cv2.BORDER_REPLICATE)
    matcher = cv2.StereoBM.create(count, _BLOCK_PX)
    matcher.setUniquenessRatio(_UNIQUENESS_PERCENT)
    matcher.setTextureThreshold(0)
    fixed = np.asarray(matcher.compute(small_left, small_right))[:, count:]
    height, width = fixed.shape
    u = np.clip(np.rint(px[:, 0] / 2).astype(np.intp), 0, width - 1)
    v = np.clip(np.rint(px[:, 1] / 2).astype(np.intp), 0, height - 1)
    found = np.full(len(px), np.nan, np.float32)
    for dv, du in _SEARCH:
        value = fixed[np.clip(v + dv, 0, height - 1), np.clip(u + du, 0, width - 1)]
        found = np.where(np.isnan(found) & (value >= 0), value * (2 / _FIXED_POINT), found)
    return np.where(found <= px[:, 0], found, np.nan).astype(np.float32)
