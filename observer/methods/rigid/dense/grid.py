"""The cells on which dense evidence works: pixels of the downscaled rectified images."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.types import Image

# Columns that resolve a person at 6 m; more would cost more and tell little.
_COLUMNS = 320
_LEAST_REDUCTION = 2
# But where the baseline is short, cells are smaller, so that the disparity at this distance,
# metres, spans so many of them; with at most so many columns.
_REACH_CELLS, _REACH_M, _MOST_COLUMNS = 2.0, 5.0, 480
# Metres up to which cells are near enough to be judged, unless their disparity spans fewer matched
# columns: then noise is too large a share of it. Where cells are too coarse for that, narrower
# columns are matched, but not more than so many: each costs time.
NEAR_M, LEAST_COLUMNS, _MOST_MATCHED = 6.6, 2.0, 640


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of ``reduction`` x ``reduction`` pixels each; disparities stay in pixels.

    Attributes:
        camera: the rectified pair. reduction: pixels per cell. width, height: in cells.
        column_px: pixels per column of the images that are matched, on which the noise of the
            disparity depends: those of a cell, or fewer where the baseline is short.
    """

    camera: StereoCamera
    reduction: int
    width: int
    height: int
    column_px: int

    @staticmethod
    def of(camera: StereoCamera) -> Grid:
        """Return the grid for the images of a camera."""
        resolving = int(camera.fb / (_REACH_CELLS * _REACH_M))
        wanted = min(round(camera.width / _COLUMNS), resolving)
        reduction = max(_LEAST_REDUCTION, math.ceil(camera.width / _MOST_COLUMNS), wanted)
        rows, columns = camera.height // reduction, camera.width // reduction
        return Grid(camera, reduction, columns, rows, _column_px(camera, reduction))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    @cached_property
    def rays(self) -> Float64Array:
        """(3, 3) from (column, row, 1) to the ray (x, y, 1), camera frame."""
        c, r = self.camera, self.reduction
        middle = (r - 1) / 2
        return np.array(
            [
                [r / c.fx, 0.0, (middle - c.cx) / c.fx],
                [0.0, r / c.fy, (middle - c.cy) / c.fy],
                [0.0, 0.0, 1.0],
            ]
        )

    @cached_property
    def cell_rays(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(h w,) x and (h w,) y of the ray (x, y, 1) through each cell, camera frame."""
        columns, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x, y, _ = self.rays @ np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
        return x.astype(np.float32), y.astype(np.float32)

    def reduced(self, image: Image) -> Image:
        """Return a grey image (H, W) downscaled to one pixel per cell."""
        return self._downscaled(image, self.width)

    def matched(self, image: Image) -> Image:
        """Return a grey image (H, W) downscaled to the rows of the cells and matched columns."""
        return self._downscaled(image, self.width * (self.reduction // self.column_px))

    def _downscaled(self, image: Image, columns: int) -> Image:
        height, width = self.height * self.reduction, self.width * self.reduction
        size = (columns, self.height)
        small = cv2.resize(image[:height, :width], size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.uint8)

    def to_cells(self, px: Float64Array) -> Float64Array:
        """(..., 2) column and row, not rounded, of pixels (..., 2)."""
        return np.asarray((px + 0.5) / self.reduction - 0.5)

    def to_px(self, cells: Float64Array) -> Float64Array:
        """(..., 2) pixels of columns and rows (..., 2)."""
        return np.asarray((cells + 0.5) * self.reduction - 0.5)

    def at(self, px: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(N,) rows and (N,) columns of the cells that hold, or are nearest to, pixels (N, 2)."""
        cells = (px / self.reduction).astype(np.intp)
        return (
            np.clip(cells[:, 1], 0, self.height - 1),
            np.clip(cells[:, 0], 0, self.width - 1),
        )

    def per_metre(self, disparity: float) -> float:
        """Return how many cells a metre across the line of sight spans at a disparity, px."""
        return disparity / (self.camera.baseline * self.reduction)


def _column_px(camera: StereoCamera, reduction: int) -> int:
    """Return the pixels per matched column for cells of so many."""
    widths = [px for px in range(reduction, 0, -1) if reduction % px == 0]
    affordable = [px for px in widths if px == reduction or camera.width <= _MOST_MATCHED * px]
    fine = [px for px in affordable if LEAST_COLUMNS * NEAR_M * px <= camera.fb]
    return fine[0] if fine else affordable[-1]
