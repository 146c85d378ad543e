"""Preview of a calibration on one raw pair, before anything uses it."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from app.contract.answers import CalibrationPreview
from app.engine.views import encode_jpeg
from observer.calibration.ageing.row_refinement import matched_points
from observer.calibration.boards.board import Board
from observer.calibration.boards.detection import detect_board, same_numbering
from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import as_gray
from observer.drawing import color_copy
from observer.geometry import Float64Array
from observer.types import Image, StereoFrame
from observer.vision.rectification import Rectification

_FEATURES = 1500
_LINES = 12
_LINE_COLOR = (80, 220, 80)
# Share of the image height: true matches in rectified images lie in one row, but the limit must be
# wide enough to show how bad a bad calibration is.
_MAX_ROW_DIFFERENCE = 0.15
# Matches whose rows differ by less are measured to a fraction of a pixel.
_NEAR_PX = 4.0
# With fewer matches a median means nothing.
_MIN_MATCHES = 12


def preview_calibration(
    frame: StereoFrame,
    calibration_yaml: str,
    beat: Callable[[], None],
    board: Board | None = None,
) -> CalibrationPreview:
    """Rectify a raw pair and measure how well the rows of both images agree.

    Args:
        board: the board shown to the cameras, if any. Its corners all look alike, so they are
            matched by number and not as features.
        beat: called between steps, each of which takes some ten milliseconds.

    Raises:
        CalibrationError: the calibration cannot be read or rectified, or is for another size.
    """
    rectification = Rectification(read_calibration(calibration_yaml, name="the calibration"))
    beat()
    left, right = rectification.apply(frame.left, frame.right)
    beat()
    rows = None if board is None else _board_rows(frame, rectification, board)
    if rows is None:
        error, count = vertical_error(left, right)
    else:
        error, count = float(np.median(np.abs(rows))), len(rows)
    beat()
    return CalibrationPreview(encode_jpeg(_side_by_side(left, right)), error, count)


def vertical_error(left: Image, right: Image) -> tuple[float | None, int]:
    """Return the median ``|v_left - v_right|`` of matched features, pixels, and the match count.

    ORB features match however far apart the rows are, but they lie on whole pixels. Where the rows
    are close, corners are tracked from left to right to a fraction of a pixel. Two tests reject ORB
    mismatches: the descriptors' ratio test, and the removal of matches far from the median row
    displacement. The median is None below 12 matches.
    """
    left, right = as_gray(left), as_gray(right)
    rows = _row_differences(left, right)
    if len(rows) < _MIN_MATCHES:
        return None, len(rows)
    coarse = float(np.median(np.abs(rows)))
    if coarse > _NEAR_PX:
        return coarse, len(rows)
    left_px, right_px = matched_points(left, right)
    if len(left_px) < _MIN_MATCHES:
        return coarse, len(rows)
    return float(np.median(np.abs(left_px[:, 1] - right_px[:, 1]))), len(left_px)


def _board_rows(
    frame: StereoFrame, rectification: Rectification, board: Board
) -> Float64Array | None:
    """Return (N,) rows of board corners, left minus right; None unless both images show it."""
    left = detect_board(as_gray(frame.left), board, quick=True)
    right = detect_board(as_gray(frame.right), board, quick=True)
    if left is None or right is None:
        return None
    right = same_numbering(left, right, board)
    common, a, b = np.intersect1d(left.ids, right.ids, return_indices=True)
    if len(common) < _MIN_MATCHES:
        return None
    left_px, right_px = rectification.rectify_points(left.px[a], right.px[b])
    rows = left_px[:, 1] - right_px[:, 1]
    return np.asarray(rows[np.isfinite(rows)], dtype=np.float64)


def _row_differences(left: Image, right: Image) -> Float64Array:
    orb = cv2.ORB.create(nfeatures=_FEATURES, fastThreshold=10)
    points_left, descriptors_left = orb.detectAndCompute(left, None)
    points_right, descriptors_right = orb.detectAndCompute(right, None)
    if len(points_left) < 2 or len(points_right) < 2:
        return np.zeros(0)
    matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
    forth = matcher.knnMatch(descriptors_left, descriptors_right, k=2)
    back = {m.queryIdx: m.trainIdx for m in matcher.match(descriptors_right, descriptors_left)}
    height, width = left.shape
    rows = []
    for pair in forth:
        if len(pair) < 2 or pair[0].distance >= 0.8 * pair[1].distance:
            continue
        best = pair[0]
        if back.get(best.trainIdx) != best.queryIdx:
            continue
        u_left, v_left = points_left[best.queryIdx].pt
        u_right, v_right = points_right[best.trainIdx].pt
        near = abs(v_left - v_right) < _MAX_ROW_DIFFERENCE * height
        # A point in front of both cameras never lies further right in the right image; allow a
        # little slack for calibrations with inaccurate principal points.
        if near and -0.02 * width < u_left - u_right < 0.5 * width:
            rows.append(v_left - v_right)
    found = np.array(rows, dtype=np.float64)
    if len(found) < _MIN_MATCHES:
        return found
    spread = np.median(np.abs(found - np.median(found)))
    near_median = np.abs(found - np.median(found)) <= 5 * max(float(spread), 0.5)
    return np.asarray(found[near_median], dtype=np.float64)


def _side_by_side(left: Image, right: Image) -> Image:
    canvas = np.ascontiguousarray(np.hstack([color_copy(left), color_copy(right)]))
    height, width = canvas.shape[:2]
    for row in np.linspace(0, height, _LINES + 2)[1:-1].round().astype(int).tolist():
        cv2.line(canvas, (0, row), (width - 1, row), _LINE_COLOR, 1)
    return canvas
