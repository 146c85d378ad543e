"""How far away one place of the newest pair is by a calibration: to be held against a tape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import as_gray
from observer.errors import InputError
from observer.geometry import Float64Array
from observer.parameters import StereoParameters
from observer.stages.rectification import Rectification
from observer.stages.stereo import disparity_map
from observer.types import StereoFrame

# The place is judged by its surroundings: pixels each way.
_REACH_PX = 7
_HERE_PX = 1
# Rows that are matched above and below, so that the matcher has paths to go along.
_MARGIN_PX = 48
_LEAST_KNOWN = 0.3
# Disparities of one flat place differ by this and less; more is an edge.
_MAX_SPREAD_PX = 1.0
_MAX_DISPARITY_PX = 256


def measure_depth(
    frame: StereoFrame, calibration_yaml: str, u: float, v: float, beat: Callable[[], None]
) -> dict[str, Any]:
    """Depth at a pixel of the rectified left image.

    Args:
        beat: called between the steps, each of which takes some ten milliseconds.

    Returns:
        ``depth_m`` along the camera's axis, ``range_m`` straight from the left camera, as a tape
        measures it, and ``disparity_px``.

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
    # As near as a hand before the cameras: somebody may point at a thing on the table.
    search = min(_MAX_DISPARITY_PX, camera.width // 3)
    parameters = StereoParameters(max_disparity_px=search)
    strip = disparity_map(left[rows], right[rows], parameters)
    beat()
    place = _around(strip, row - first, column, _REACH_PX)
    known = place[np.isfinite(place)]
    if len(known) < _LEAST_KNOWN * place.size:
        raise InputError(
            "this place has no depth: choose one with texture that both cameras see"
        )
    disparity = float(np.median(known))
    # Around a thin thing most is what stands behind it.
    here = _around(strip, row - first, column, _HERE_PX)
    here = here[np.isfinite(here)]
    elsewhere = len(here) > 0 and abs(float(np.median(here)) - disparity) > _MAX_SPREAD_PX
    if elsewhere or float(np.median(np.abs(known - disparity))) > _MAX_SPREAD_PX:
        raise InputError("this place lies at an edge: choose one in the middle of a flat thing")
    point = camera.triangulate((u, v), disparity)
    distance = float(np.linalg.norm(point))
    return {
        "range_m": distance,
        "depth_m": float(point[2]),
        "disparity_px": disparity,
    }


def _around(disparity: NDArray[np.float32], row: int, column: int, reach: int) -> Float64Array:
    """What lies up to ``reach`` pixels away and within the image."""
    rows = slice(max(0, row - reach), row + reach + 1)
    columns = slice(max(0, column - reach), column + reach + 1)
    return disparity[rows, columns].astype(np.float64)
