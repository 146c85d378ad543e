"""Disparity only where it is needed: a coarse search along the row for new points."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.row_search import contradicted_by_rows, search_rows
from observer.parameters import StereoParameters
from observer.types import Image

# The search works at half the resolution; Lucas-Kanade refines the result.
_REDUCTION = 2
# Side of the compared blocks, in the reduced images.
_BLOCK_PX = 9
# Gradients are compared rather than grey levels, because the cameras' brightness differs. This is
# none; they are capped at as much to either side, so that one edge does not outvote the rest (as in
# OpenCV's StereoBM).
FLAT = 31
# The best disparity must cost this share less than all but its neighbours,
_UNIQUENESS = np.float32(0.1)
# and this many grey levels per pixel less: among equal repetitions, noise would pick one.
_LEAST_GAP = np.float32(0.5 * _BLOCK_PX**2)
# Share of the mean cost within its own row below which a block recurs there. Of the points on
# moving robots and people 1 in 100 recur by this measure, of those that matched a fence wrongly
# more than half.
_RECURRENCE = np.float32(0.25)
# Pixels: disparities that differ more belong to different surfaces; the one found is accurate to
# about 1 px.
_ANOTHER_DISPARITY_PX = np.float32(2.5)


@dataclass(frozen=True, eq=False)
class RowMatches:
    """Matches of N points.

    Attributes:
        disparity: (N,) px, to within about a pixel; NaN where none or several places match.
        recurs: (N,) whether the block recurs on its own row, as on a fence: there a wrong match
            may be the only good one.
    """

    disparity: NDArray[np.float32]
    recurs: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RowSearch:
    """Block matching at single points of one stereo pair.

    The block around each point is compared with all blocks on its row of the right image, up to
    the largest disparity. The match has the least sum of absolute differences of the horizontal
    gradient, and must be unique (block matching as in Konolige: Small Vision Systems, ISRR 1997,
    at the points only).

    Attributes:
        left: (h, w), right: (h, w + count) horizontal gradients of the reduced images, padded.
        count: the largest disparity, pixels of the reduced images.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    count: int

    @staticmethod
    def of(left: Image, right: Image, parameters: StereoParameters) -> RowSearch:
        """Return the search in a pair (H, W), grey, rectified, up to ``max_disparity_px``."""
        count, half = -(-parameters.max_disparity_px // _REDUCTION), _BLOCK_PX // 2
        # Points near the left border may be seen by both; outside the image the border is
        # replicated.
        return RowSearch(_gradients(left, half, half), _gradients(right, half, half + count), count)

    def matches(self, px: NDArray[np.float32]) -> RowMatches:
        """Match left pixels (N, 2)."""
        disparity, recurs = search_rows(
            self.left,
            self.right,
            np.ascontiguousarray(px, np.float32),
            _REDUCTION,
            _BLOCK_PX,
            self.count,
            _UNIQUENESS,
            _LEAST_GAP,
            _RECURRENCE,
        )
        return RowMatches(disparity, recurs)

    def contradicts(
        self, px: NDArray[np.float32], disparity: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """(N,) which left pixels (N, 2) match clearly better at another disparity than theirs.

        Beside a depth edge a point may get, and keep, the disparity of the surface across the
        edge, because left and right look alike there; once the surroundings have shifted, its own
        surface matches better.

        Args:
            disparity: (N,) px; NaN is not contradicted.
        """
        return contradicted_by_rows(
            self.left,
            self.right,
            np.ascontiguousarray(px, np.float32),
            np.ascontiguousarray(disparity, np.float32),
            _REDUCTION,
            _BLOCK_PX,
            self.count,
            _UNIQUENESS,
            _LEAST_GAP,
            _ANOTHER_DISPARITY_PX,
        )


def _gradients(image: Image, border: int, left: int) -> NDArray[np.uint8]:
    """(h, w) gradients of the reduced image, padded by these borders, pixels."""
    steep = row_gradients(np.asarray(cv2.pyrDown(image), np.uint8))
    return np.asarray(
        cv2.copyMakeBorder(steep, border, border, left, border, cv2.BORDER_REPLICATE), np.uint8
    )


def row_gradients(image: Image) -> NDArray[np.uint8]:
    """(h, w) capped horizontal gradients of an image (h, w); ``FLAT`` where there is none."""
    steep = cv2.Sobel(image, cv2.CV_8U, 1, 0, delta=FLAT)
    return np.asarray(cv2.threshold(steep, 2 * FLAT, 0, cv2.THRESH_TRUNC)[1], np.uint8)
