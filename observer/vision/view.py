"""One rectified stereo pair as the methods work on it, and where its points match."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.types import Image, Odometry, StereoFrame


@dataclass(frozen=True, eq=False)
class View:
    """A rectified pair in grey, as the methods work on it.

    Attributes:
        index: number of the frame. time: exposure of the left image, seconds, source clock.
        right_time: exposure of the right one, seconds; None if it is that of the left.
        left, right: (H, W). odometry: of the robot's wheels; None unknown.
    """

    index: int
    time: float
    right_time: float | None
    left: Image
    right: Image
    odometry: Odometry | None = None

    @staticmethod
    def of(frame: StereoFrame, left: Image, right: Image) -> View:
        """Return the view of a frame with its rectified grey images."""
        return View(frame.index, frame.time, frame.right_time, left, right, frame.odometry)


@dataclass(frozen=True, eq=False)
class StereoRows:
    """Stereo matches of N points of the left image, to check the calibration.

    Attributes:
        px: (N, 2) pixels, left image. offset_px: (N,) left minus right row, pixels.
        disparity: (N,) pixels at the left image's exposure; NaN unknown.
        number: (N,) each point's own number, never reused within a segment.
    """

    px: Float64Array
    offset_px: Float64Array
    disparity: Float64Array
    number: NDArray[np.int64]
