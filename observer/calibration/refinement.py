"""Setting a pair's rows straight from what it sees: pitch and roll between the two cameras.

A stereo head that was bumped, warmed or driven for months is off by hundredths of a degree, half
a pixel at a focal length of 1000. Rows tell that apart from the scene, columns do not: vergence
looks like depth. So vergence, baseline and lenses stay as calibrated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from observer.camera import StereoCalibration, StereoCamera, as_gray
from observer.geometry import Float64Array
from observer.stages.rectification import Rectification
from observer.types import Image

# Fewer matches do not tell two angles from the mismatches among them.
_MIN_MATCHES = 200
# A larger error is no drift but another calibration, or left and right from different instants.
_MAX_TURN_RAD = np.deg2rad(0.3)
# Where an error begins to count as a mismatch, pixels.
_SOFT_PX = 0.3
_MAX_VERTICAL_PX = 8.0


@dataclass(frozen=True, eq=False)
class RowRefinement:
    """A calibration turned by a little, and what that gained.

    Attributes:
        calibration: the refined one; lenses, baseline and vergence are those of the given one.
        pitch_rad, roll_rad: the turn of the rectified right camera about x and z.
        before_px, after_px: median vertical distance of matches after rectification, pixels.
        matches: number of matches it rests on.
    """

    calibration: StereoCalibration
    pitch_rad: float
    roll_rad: float
    before_px: float
    after_px: float
    matches: int


def refine_rows(
    calibration: StereoCalibration, pairs: Iterable[tuple[Image, Image]]
) -> RowRefinement | None:
    """Pitch and roll of the right camera that bring matches of these pairs into one row.

    Args:
        calibration: nearly right: rows agree to a few pixels.
        pairs: left and right images as taken, of the calibration's size.

    Returns:
        The refinement, or None where the pairs show too few matches, the turn would be more than
        a drift, or nothing would be gained.

    Raises:
        CalibrationError: the calibration cannot be rectified or is for images of another size.
    """
    rectification = Rectification(calibration)
    camera = rectification.camera
    found = [matched_points(*rectification.apply(left, right)) for left, right in pairs]
    left_px = np.concatenate([np.empty((0, 2)), *(left for left, _ in found)])
    right_px = np.concatenate([np.empty((0, 2)), *(right for _, right in found)])
    if len(left_px) < _MIN_MATCHES:
        return None

    def errors(turn: Float64Array) -> Float64Array:
        rows = _turned_rows(camera, right_px, turn)
        return np.asarray(rows - left_px[:, 1], dtype=np.float64)

    fit = least_squares(errors, np.zeros(2), loss="soft_l1", f_scale=_SOFT_PX, x_scale=1e-4)
    before = float(np.median(np.abs(errors(np.zeros(2)))))
    after = float(np.median(np.abs(errors(fit.x))))
    if np.abs(fit.x).max() > _MAX_TURN_RAD or after >= before:
        return None
    # R_rectified_left stays; the rectified right camera is turned, and with it R and T.
    R_rectified_right = _turn(fit.x) @ rectification.R_rectified_left @ calibration.R.T
    return RowRefinement(
        calibration=replace(
            calibration,
            R=R_rectified_right.T @ rectification.R_rectified_left,
            T=R_rectified_right.T @ np.array([-camera.baseline, 0, 0]),
        ),
        pitch_rad=float(fit.x[0]),
        roll_rad=float(fit.x[1]),
        before_px=before,
        after_px=after,
        matches=len(left_px),
    )


def matched_points(left: Image, right: Image) -> tuple[Float64Array, Float64Array]:
    """Sub-pixel positions (N, 2) of one scene point each in a rectified pair.

    Corners (Shi and Tomasi) are tracked from left to right and back (Lucas-Kanade in two
    dimensions, so that a vertical distance shows); those that do not come back are dropped.
    """
    left, right = as_gray(left), as_gray(right)
    found = cv2.goodFeaturesToTrack(left, 1000, 0.005, 7)
    # OpenCV answers None where there is no corner, which its type stubs do not know.
    corners = np.asarray([] if found is None else found, dtype=np.float32).reshape(-1, 1, 2)
    if not len(corners):
        return np.empty((0, 2)), np.empty((0, 2))
    there, ok_there = _tracked(left, right, corners)
    back, ok_back = _tracked(right, left, there)
    start, end = corners.reshape(-1, 2), there.reshape(-1, 2)
    shift = end - start
    good = ok_there & ok_back
    good &= np.linalg.norm(back.reshape(-1, 2) - start, axis=1) < 0.5
    # Points in front of the cameras lie further left in the right image.
    good &= (shift[:, 0] < 1) & (np.abs(shift[:, 1]) < _MAX_VERTICAL_PX)
    return start[good].astype(np.float64), end[good].astype(np.float64)


def _tracked(
    a: Image, b: Image, points: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    found, ok, _ = cv2.calcOpticalFlowPyrLK(
        a, b, points, points.copy(), winSize=(21, 21), maxLevel=5
    )
    return np.asarray(found, dtype=np.float32), np.asarray(ok).ravel() == 1


def _turned_rows(camera: StereoCamera, px: Float64Array, turn: Float64Array) -> Float64Array:
    """Rows (N,) of the pixels (N, 2) after turning the camera by pitch and roll."""
    rays = np.stack(
        [
            (px[:, 0] - camera.cx) / camera.fx,
            (px[:, 1] - camera.cy) / camera.fy,
            np.ones(len(px)),
        ],
        axis=1,
    )
    turned = rays @ _turn(turn).T
    return np.asarray(turned[:, 1] / turned[:, 2] * camera.fy + camera.cy, dtype=np.float64)


def _turn(pitch_roll: Float64Array) -> Float64Array:
    rotvec = [pitch_roll[0], 0.0, pitch_roll[1]]
    return np.asarray(Rotation.from_rotvec(rotvec).as_matrix(), dtype=np.float64)
