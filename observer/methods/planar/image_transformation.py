"""Step 5 of the method: both images of t+dt, transformed into the frame of t."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.types import Image


@dataclass(frozen=True, eq=False)
class TransformedPair:
    """The pair of t+dt as the camera at t would have seen it if the scene were a plane.

    Attributes:
        left, right: (H, W) uint8, black where nothing is known.
        valid: (H, W) bool, where both images have values; the same for left and right, because
            both are transformed alike.
    """

    left: Image
    right: Image
    valid: NDArray[np.bool_]


def transform_images(left: Image, right: Image, homography: Float64Array) -> TransformedPair:
    """Warp both images of t+dt by the motion found in the left one.

    Args:
        left, right: (H, W) grey at t+dt.
        homography: (3, 3) pixel map from t to t+dt; an affine one has (0, 0, 1) below.
    """
    height, width = left.shape
    inside = np.full((height, width), 255, np.uint8)
    return TransformedPair(
        left=_warp(left, homography),
        right=_warp(right, homography),
        # A pixel interpolated with the black outside is invalid.
        valid=_warp(inside, homography) == 255,
    )


def _warp(image: Image, homography: Float64Array) -> Image:
    size = (image.shape[1], image.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    if not homography[2, :2].any():
        warped = cv2.warpAffine(image, homography[:2] / homography[2, 2], size, flags=flags)
    else:
        warped = cv2.warpPerspective(image, homography, size, flags=flags)
    return np.asarray(warped, dtype=np.uint8)
