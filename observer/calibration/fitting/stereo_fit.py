"""Result of the fit of a pair of cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.calibration.boards.board import Board
from observer.calibration.fitting.flatness import Bend
from observer.calibration.fitting.held_out import HeldOut
from observer.calibration.fitting.lens import directions
from observer.calibration.fitting.outlier_views import ViewError
from observer.calibration.fitting.uncertainty import Interval95
from observer.camera import StereoCalibration


@dataclass(frozen=True)
class DepthBias:
    """Effect of the calibration's uncertainty on depth: a relative error and a disparity offset.

    Attributes:
        covariances: estimates, usually one, of the covariance (2, 2) of the relative error and
            the disparity offset in pixels, row by row.
    """

    covariances: tuple[tuple[float, ...], ...]

    def relative_sigma(self, per_disparity: float) -> float:
        """One standard deviation of depth's relative error, by the largest of the estimates.

        Args:
            per_disparity: Z / (f B) of the depth Z, the inverse of its disparity, 1/px.
        """
        q = -per_disparity
        return math.sqrt(
            max(0.0, *(a + q * (b + c) + q * q * d for a, b, c, d in self.covariances))
        )


@dataclass(frozen=True, eq=False)
class StereoFit:
    """A calibration, and how good it is.

    Attributes:
        calibration: from all used views.
        board: the one shown.
        rms_left, rms_right, rms_stereo: root mean square reprojection error, pixels.
        views: of all that were given, in their order.
        pairs: how many used views both cameras saw.
        interval_95: half of the 95 % intervals of the parameters.
        depth_bias: effect of the uncertainty on depth.
        held_out: None where there were too few views to hold some out.
        coverage: share of the left and of the right image's cells that corners fell into.
        bend: estimated bend of the board; None where the views do not determine it.
    """

    calibration: StereoCalibration
    board: Board
    rms_left: float
    rms_right: float
    rms_stereo: float
    views: tuple[ViewError, ...]
    pairs: int
    interval_95: Interval95
    depth_bias: DepthBias
    held_out: HeldOut | None
    coverage: tuple[float, float]
    bend: Bend | None

    @property
    def field_of_view_deg(self) -> tuple[float, float]:
        """Horizontal and vertical angle of the left camera, through its principal point."""
        c = self.calibration
        cx, cy = float(c.K1[0, 2]), float(c.K1[1, 2])
        ends = np.array([[-0.5, cy], [c.width - 0.5, cy], [cx, -0.5], [cx, c.height - 0.5]])
        look = directions(c.distortion_model, c.K1, c.D1, ends)
        across, down = np.degrees(np.arctan(look[:2, 0])), np.degrees(np.arctan(look[2:, 1]))
        return float(across[1] - across[0]), float(down[1] - down[0])
