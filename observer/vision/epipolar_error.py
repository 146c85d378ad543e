"""The epipolar error of a rectified pair: how far apart the rows of matched points are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.number_format import format_number
from observer.robust import MAD_TO_SIGMA, median, tukey_weights

# Fewer points determine a slope too poorly.
_MIN_ROW_POINTS = 20
_FIT_ROUNDS = 4
# Lucas-Kanade finds rows to 0.05 px at best; keeps perfect data from becoming outliers.
_MIN_SIGMA_PX = 0.05
_SURE_SIGMAS = 3.0


@dataclass(frozen=True)
class EpipolarError:
    """Vertical disparity of a rectified pair: v_left - v_right of the same points.

    Attributes:
        median_px: the median, signed. centre_px: the fitted plane at the principal point.
        p95_px: 95 % of the points that fit the plane lie within this distance of 0.
        typical_px: root mean square of the fitted plane over the image. typical_std_px: its
            standard deviation.
        roll_rad: rotation of the right image relative to the left one, clockwise positive.
        stretch: by how much the right image is taller than the left one; 0.01 is one per cent.
        count: number of points that fit.
    """

    median_px: float
    centre_px: float
    p95_px: float
    typical_px: float
    typical_std_px: float
    roll_rad: float
    stretch: float
    count: int


def epipolar_error(
    px_left: NDArray[np.floating], vertical_disparity: NDArray[np.floating], camera: StereoCamera
) -> EpipolarError | None:
    """Fit a plane to the vertical disparities with Tukey's weights; None with too few points.

    A wrong pitch between the cameras shifts all rows, a wrong roll tilts them along u, a wrong
    focal length along v (Hartley and Zisserman, Multiple View Geometry, 11.12). Takes 0.3 ms.

    Args:
        px_left: (N, 2) pixels in the left image.
        vertical_disparity: (N,) v_left - v_right in pixels; values that are not finite are left
            out.
    """
    vertical = np.asarray(vertical_disparity, dtype=np.float64)
    known = np.isfinite(vertical)
    if np.count_nonzero(known) < _MIN_ROW_POINTS:
        return None
    y = vertical[known]
    px = np.asarray(px_left, dtype=np.float64)[known]
    # In half image sizes, so that all three parameters are pixels of comparable effect.
    half = np.array([camera.width / 2, camera.height / 2])
    A = np.column_stack([np.ones(len(y)), (px - (camera.cx, camera.cy)) / half])
    plane = np.array([median(y), 0.0, 0.0])
    weight = np.ones(len(y))
    sigma = _MIN_SIGMA_PX
    for _ in range(_FIT_ROUNDS):
        residual = y - A @ plane
        sigma = max(_MIN_SIGMA_PX, MAD_TO_SIGMA * median(np.abs(residual)))
        weight = tukey_weights(residual, sigma)
        # A tiny prior of 1e-6 keeps collinear points from producing an arbitrary slope.
        information = (A * weight[:, None]).T @ A + np.diag([0.0, 1e-6, 1e-6]) * len(y)
        plane = np.linalg.solve(information, A.T @ (weight * y))
    fitting = weight > 0
    if np.count_nonzero(fitting) < _MIN_ROW_POINTS:
        return None
    sizes = np.sort(np.abs(y[fitting]))
    # Mean square of the plane over the image: a half-range of h contributes h^2 / 3.
    share = np.array([1.0, 1 / 3, 1 / 3])
    typical = float(np.sqrt(share @ plane**2))
    covariance = sigma**2 * np.linalg.inv(information)
    gradient = share * plane / max(typical, 1e-9)
    return EpipolarError(
        median_px=median(y[fitting]),
        centre_px=float(plane[0]),
        p95_px=float(sizes[int(0.95 * (len(sizes) - 1))]),
        typical_px=typical,
        typical_std_px=float(np.sqrt(gradient @ covariance @ gradient)),
        roll_rad=float(-plane[1] / half[0]),
        stretch=float(-plane[2] / half[1]),
        count=int(np.count_nonzero(fitting)),
    )


def epipolar_reason(error: EpipolarError | None, warn_px: float = 1.0) -> str | None:
    """Check whether the rows of a rectified pair are too far apart for matching along rows.

    Block matching loses its support within one to two pixels, hence ``warn_px``. An error that
    exceeds it by less than three standard deviations is not reported.
    """
    if error is None or error.typical_px - _SURE_SIGMAS * error.typical_std_px <= warn_px:
        return None
    median_px = format_number(error.median_px, 1, signed=True)
    roll_deg = format_number(float(np.degrees(error.roll_rad)), 2, signed=True)
    return (
        f"the epipolar error is {error.typical_px:.1f} px (median {median_px} px, 95 % "
        f"within {error.p95_px:.1f} px, rotation {roll_deg} deg; the limit "
        f"is {warn_px:g} px): recalibrate"
    )
