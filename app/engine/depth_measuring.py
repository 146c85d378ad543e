"""Depth of one point in the newest pair under a calibration, to compare with a tape measure."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from app.contract.calibrating import PlaceDepth
from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import as_gray
from observer.errors import InputError
from observer.parameters import StereoParameters
from observer.types import Image, StereoFrame
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map

# Half size of the neighbourhood examined around the point, pixels in each direction.
_REACH_PX = 7
_HERE_PX = 1
# Extra rows matched above and below, so that the matcher has paths to follow.
_MARGIN_PX = 48
_LEAST_KNOWN = 0.3
# Pixels, on a flat surface: largest median deviation of the disparities from one plane, over the
# neighbourhood and at its middle.
_MAX_SPREAD_PX = 0.5
_MAX_HERE_PX = 1.0
_MAX_DISPARITY_PX = 256
# Grey levels per pixel: RMS gradient along the rows of the smoothed image. Noise of three grey
# levels leaves a third of this. Below it, the matcher fills in values from neighbours.
_LEAST_TEXTURE = 0.7
_SMOOTHING_PX = 1.5

_NO_DEPTH = "there is no depth at this spot: choose a textured spot that both cameras see"


def measure_depth(
    frame: StereoFrame, calibration_yaml: str, u: float, v: float, beat: Callable[[], None]
) -> PlaceDepth:
    """Return the depth at a pixel of the rectified left image.

    Args:
        beat: called between steps, each of which takes some ten milliseconds.

    Raises:
        InputError: the pixel is outside the image, or has no depth.
        CalibrationError: the calibration does not fit the images.
    """
    rectification = Rectification(read_calibration(calibration_yaml, name="the calibration"))
    camera = rectification.camera
    if not (0 <= u <= camera.width - 1 and 0 <= v <= camera.height - 1):
        raise InputError(
            f"the pixel {u:g}, {v:g} is outside the image of {camera.width} x {camera.height}"
        )
    left, right = rectification.apply(as_gray(frame.left), as_gray(frame.right))
    beat()
    row, column = round(v), round(u)
    first = max(0, row - _MARGIN_PX)
    rows = slice(first, min(camera.height, row + _MARGIN_PX + 1))
    # Search down to a hand's distance from the cameras: a user may pick an object on the table.
    search = min(_MAX_DISPARITY_PX, camera.width // 3)
    parameters = StereoParameters(max_disparity_px=search)
    strip = disparity_map(left[rows], right[rows], parameters)
    beat()
    if _texture(left[_around(row), _around(column)]) < _LEAST_TEXTURE:
        raise InputError(_NO_DEPTH)
    disparity = _disparity_of_place(strip, row - first, column)
    point = camera.triangulate((u, v), disparity)
    distance = float(np.linalg.norm(point))
    return PlaceDepth(range_m=distance, depth_m=float(point[2]), disparity_px=disparity)


def _disparity_of_place(strip: NDArray[np.float32], row: int, column: int) -> float:
    """Return the disparity at the point, by a plane fit: a floor's disparity grows by row.

    Raises:
        InputError: too few disparities are known around it, or they form no plane.
    """
    rows, columns = _around(row), _around(column)
    place = strip[rows, columns].astype(np.float64)
    known = np.isfinite(place)
    if known.mean() < _LEAST_KNOWN:
        raise InputError(_NO_DEPTH)
    down, across = np.nonzero(known)
    down, across = down + rows.start - row, across + columns.start - column
    found = place[known]
    terms = np.column_stack([np.ones(len(found)), across, down])
    plane, *_ = np.linalg.lstsq(terms, found, rcond=None)
    off = found - terms @ plane
    # Around a thin object most pixels show the background, so test the point itself as well.
    here = off[np.maximum(abs(down), abs(across)) <= _HERE_PX]
    elsewhere = len(here) > 0 and abs(float(np.median(here))) > _MAX_HERE_PX
    if elsewhere or float(np.median(np.abs(off))) > _MAX_SPREAD_PX:
        raise InputError("this spot is at a depth edge: choose one in the middle of a flat surface")
    return float(plane[0])


def _around(middle: int) -> slice:
    return slice(max(0, middle - _REACH_PX), middle + _REACH_PX + 1)


def _texture(image: Image) -> float:
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _SMOOTHING_PX)
    return float(np.sqrt(np.mean(np.square(np.diff(smooth, axis=1)))))
