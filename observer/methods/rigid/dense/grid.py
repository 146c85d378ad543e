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


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells of ``reduction`` x ``reduction`` pixels each; disparities stay in pixels.

    Attributes:
        camera: the rectified pair. reduction: pixels per cell. width, height: in cells.
    """

    camera: StereoCamera
    reduction: int
    width: int
    height: int

    @staticmethod
    def of(camera: StereoCamera) -> Grid:
        """Return the grid for the images of a camera."""
        resolving = int(camera.fb / (_REACH_CELLS * _REACH_M))
        wanted = min(round(camera.width / _COLUMNS), resolving)
        reduction = max(_LEAST_REDUCTION, math.ceil(camera.width / _MOST_COLUMNS), wanted)
        return Grid(camera, reduction, camera.width // reduction, camera.height // reduction)

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
        height, width = self.height * self.reduction, self.width * self.reduction
        small = cv2.resize(
            image[:height, :width], (self.width, self.height), interpolation=cv2.INTER_AREA
        )
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
