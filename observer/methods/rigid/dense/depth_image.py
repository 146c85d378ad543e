"""Dense disparity of the cells, known only where texture supports it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.dense.grid import Grid
from observer.parameters import StereoParameters
from observer.robust import MAD_TO_SIGMA, median
from observer.types import Image
from observer.vision.stereo import FIXED_POINT

_BLOCK = 3
_UNIQUENESS_PERCENT = 5
_SPECKLE_CELLS = 40
_SPECKLE_RANGE = 2
# Texture is a horizontal step of so many grey levels, and of so many deviations of the noise.
_TEXTURE = 4.0
_TEXTURE_SIGMAS = 4.0
# The smoothness term fills areas without texture: up to so many cells from texture on the same row
# the disparity is true, further away it is invented.
_SUPPORT_CELLS = 10
# Pixels, most by which the disparities of columns on one thing differ.
_ALIKE_PX = 1.0
# The Sobel operator sums a step four times, and the noise variance over weights whose squares add
# up to twelve.
_SOBEL_STEP, _SOBEL_NOISE = 4.0, 12.0**0.5


@dataclass(frozen=True, eq=False)
class RowTexture:
    """Texture of an image along its rows.

    Attributes:
        step: grey levels, least step that stands out of the noise.
        near: (h, w) which pixels have a larger step near them on their row.
    """

    step: float
    near: NDArray[np.bool_]

    @staticmethod
    def of(image: Image) -> RowTexture:
        """Return the texture of an image (h, w)."""
        step = least_step(image)
        return RowTexture(step, textured(image, step))


def depth_image(
    left: Image, right: Image, texture: RowTexture, grid: Grid, parameters: StereoParameters
) -> NDArray[np.float32]:
    """Return the disparity (h, w) of the cells, pixels of the full image; NaN unknown.

    Semi-global matching (Hirschmueller, 2008) on the reduced pair; its smoothness term carries the
    disparity of contours over plain clothes. What lies far from any texture is left out.

    Args:
        left, right: (h, w k) grey, rectified, as ``Grid.matched`` gives them.
        texture: of the left one, by cells.
    """
    count = -(-parameters.max_disparity_px // (16 * grid.column_px)) * 16
    # The matcher leaves out as many columns at the left as it searches disparities.
    wide = [
        cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)
    ]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=count,
        blockSize=_BLOCK,
        P1=8 * _BLOCK**2,
        P2=32 * _BLOCK**2,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=_UNIQUENESS_PERCENT,
        speckleWindowSize=_SPECKLE_CELLS * (grid.reduction // grid.column_px),
        speckleRange=_SPECKLE_RANGE,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    fixed = np.asarray(matcher.compute(*wide))[:, count:]
    # A match beyond the right image's left edge was made in the added columns.
    inside = fixed <= FIXED_POINT * np.arange(fixed.shape[1], dtype=np.int16)
    columns = np.asarray(fixed * np.float32(grid.column_px / FIXED_POINT), np.float32)
    columns[~((fixed > 0) & inside)] = np.nan
    disparity = _by_cells(columns, grid)
    disparity[~texture.near] = np.nan
    return disparity


def _by_cells(columns: NDArray[np.float32], grid: Grid) -> NDArray[np.float32]:
    """(h, w) disparity, px, of the cells: of what is nearest in their columns (h, w k)."""
    count = grid.reduction // grid.column_px
    if count == 1:
        return columns
    each = [columns[:, k::count] for k in range(count)]
    nearest = np.fmax.reduce(each)
    total, alike = np.zeros_like(nearest), np.zeros_like(nearest)
    for column in each:
        is_alike = column > nearest - _ALIKE_PX
        total += np.where(is_alike, column, np.float32(0))
        alike += is_alike
    return np.asarray(np.divide(total, alike, out=nearest, where=alike > 0), np.float32)


def least_step(image: Image) -> float:
    """Return the least horizontal step, grey levels, that stands out of the image's own noise."""
    return float(max(_TEXTURE, _TEXTURE_SIGMAS * _SOBEL_NOISE / _SOBEL_STEP * noise_of(image)))


def textured(image: Image, step: float) -> NDArray[np.bool_]:
    """(h, w) which pixels have a step of more than so many grey levels near them on their row."""
    # Comparing integers takes a tenth of the time.
    steep = np.abs(cv2.Sobel(image, cv2.CV_16S, 1, 0)) > int(_SOBEL_STEP * step)
    row = np.ones((1, 2 * _SUPPORT_CELLS + 1), np.uint8)
    return np.asarray(cv2.dilate(steep.view(np.uint8), row), np.uint8).view(np.bool_)


def noise_of(image: Image) -> float:
    """Return the standard deviation of the noise of an image, grey levels.

    By the mixed second difference, which cancels brightness and straight edges along rows and
    columns, and its median, which ignores texture (after Immerkaer, 1996).
    """
    levels = image.astype(np.int16)
    top, bottom = levels[:-1:2], levels[1::2]
    mixed = (top[:, :-1:2] - top[:, 1::2]) - (bottom[:, :-1:2] - bottom[:, 1::2])
    # The sum of four independent values has twice their deviation.
    return median(np.abs(mixed).ravel()) * MAD_TO_SIGMA / 2
