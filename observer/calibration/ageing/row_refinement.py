"""Refinement of pitch, roll and vergence between the two cameras from what they see.

A stereo head that was bumped, warmed or driven for months is off by hundredths of a degree, half
a pixel at a focal length of 1000. Row offsets show pitch and roll whatever the scene; column
offsets do not show vergence, which looks like depth. It is corrected only as measured in a drive
(``VergenceCheck``); baseline and lenses stay as calibrated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from observer.calibration.ageing.vergence import VergenceCheck
from observer.camera import StereoCalibration, StereoCamera, as_gray
from observer.geometry import Float64Array
from observer.intervals import half_95
from observer.number_format import format_number
from observer.types import Image
from observer.vision.rectification import Rectification

# With fewer matches, two angles cannot be distinguished from the mismatches among them.
_MIN_MATCHES = 200
# A larger error is not drift but another calibration, or left and right from different instants.
_MAX_TURN_RAD = np.deg2rad(0.4)
# Where an error begins to count as a mismatch, pixels.
_SOFT_PX = 0.3
_MAX_VERTICAL_PX = 8.0
# Roll tilts the rows along u: the middle 90 % of the matches must span this share of the width.
_MIN_SPREAD = 0.4
# Largest standard deviation of either angle, as pixels: pitch everywhere, roll at the image's edge.
_MAX_STD_PX = 0.3
# The image is divided into so many columns and rows, to measure how much of it has matches, and
# because matches in one cell share the errors that the lens model leaves there.
_CELLS = (8, 6)
_MIN_IN_CELL = 3
# Matching and interpolation shift whole images by up to this many pixels (measured on rendered
# pairs).
_SHARED_PX = 0.03


@dataclass(frozen=True, eq=False)
class RowRefinement:
    """A slightly rotated calibration, and what that gained.

    Attributes:
        calibration: the refined one; lenses and baseline are those of the given one.
        pitch_rad, roll_rad: rotation of the rectified right camera about x and z; 0 where the rows
            need none.
        pitch_std_rad, roll_std_rad: one standard deviation of each.
        vergence_rad: by how much more the cameras converge than in the given one, a rotation of
            ``-vergence_rad`` about y; None where the vergence is unchanged.
        vergence_std_rad: one standard deviation of it.
        before_px, after_px: median vertical distance of matches after rectification, pixels.
        before_p95_px, after_p95_px: its 95th percentile.
        matches: number of matches used. pairs: number of pairs that have any.
        coverage: share of the image's cells that have matches.
    """

    calibration: StereoCalibration
    pitch_rad: float
    roll_rad: float
    pitch_std_rad: float
    roll_std_rad: float
    vergence_rad: float | None
    vergence_std_rad: float | None
    before_px: float
    after_px: float
    before_p95_px: float
    after_p95_px: float
    matches: int
    pairs: int
    coverage: float


@dataclass(frozen=True)
class RefinementRefusal:
    """Reason why the calibration stays as it is: one sentence that says what would help."""

    reason: str


def refine_from_scene(
    calibration: StereoCalibration,
    pairs: Iterable[tuple[Image, Image]],
    vergence: VergenceCheck | None = None,
) -> RowRefinement | RefinementRefusal:
    """Estimate the pitch and roll of the right camera that align the rows of these pairs.

    A vergence that drifted is corrected as well, even if the rows need no correction.

    The given calibration is not changed.

    Args:
        calibration: nearly right: rows agree to a few pixels.
        pairs: left and right images as taken, of the calibration's size, (H, W) grey or
            (H, W, 3) BGR; best from different places, with texture all over the image.
        vergence: as measured in a drive with this calibration; None if unknown.

    Raises:
        CalibrationError: the calibration cannot be rectified or is for images of another size.
    """
    rectification = Rectification(calibration)
    matches = _Matches.of(rectification, pairs)
    refusal = _too_few(matches) or _too_narrow(matches)
    if refusal is not None:
        return refusal
    drift = None if vergence is None or vergence.status != "drifted" else vergence.vergence_rad
    yaw = 0.0 if drift is None else -drift
    turn = _aligning_turn(matches, yaw)
    std = _deviations(matches, turn, yaw)
    refusal = _implausible(turn) or _too_uncertain(matches.camera, std)
    if refusal is not None:
        return refusal
    before, before_p95 = _quantiles(matches.row_offsets)
    after, after_p95 = _quantiles(matches.turned_row_offsets(turn, yaw))
    if after >= before or not (np.abs(turn) > 2 * std).any():
        if drift is None:
            return RefinementRefusal(
                f"the epipolar error is {before:.2f} px (median of {len(matches.left_px)} "
                "matches), and no correction improves on it significantly: the calibration needs "
                "no refinement"
            )
        turn = np.zeros(2)
        after, after_p95 = _quantiles(matches.turned_row_offsets(turn, yaw))
    return RowRefinement(
        calibration=with_turned_right_camera(
            calibration, rectification, np.array([turn[0], yaw, turn[1]])
        ),
        pitch_rad=float(turn[0]),
        roll_rad=float(turn[1]),
        pitch_std_rad=float(std[0]),
        roll_std_rad=float(std[1]),
        vergence_rad=drift,
        vergence_std_rad=None if vergence is None or drift is None else vergence.std_rad,
        before_px=before,
        after_px=after,
        before_p95_px=before_p95,
        after_p95_px=after_p95,
        matches=len(matches.left_px),
        pairs=matches.showing,
        coverage=_coverage(matches.camera, matches.left_px),
    )


@dataclass(frozen=True, eq=False)
class _Matches:
    """Points of the scene in the rectified images of all pairs together.

    Attributes:
        left_px, right_px: (N, 2) pixels.
        pairs: number of pairs. showing: number of those that have any match.
    """

    camera: StereoCamera
    left_px: Float64Array
    right_px: Float64Array
    pairs: int
    showing: int

    @classmethod
    def of(cls, rectification: Rectification, pairs: Iterable[tuple[Image, Image]]) -> _Matches:
        """Match left and right of each pair, given as taken."""
        found = [matched_points(*rectification.apply(left, right)) for left, right in pairs]
        return cls(
            camera=rectification.camera,
            left_px=np.concatenate([np.empty((0, 2)), *(left for left, _ in found)]),
            right_px=np.concatenate([np.empty((0, 2)), *(right for _, right in found)]),
            pairs=len(found),
            showing=sum(len(left) > 0 for left, _ in found),
        )

    @property
    def row_offsets(self) -> Float64Array:
        """By how many pixels (N,) each match is lower in the right image."""
        return np.asarray(self.right_px[:, 1] - self.left_px[:, 1], dtype=np.float64)

    def turned_row_offsets(self, pitch_roll: Float64Array, yaw: float) -> Float64Array:
        """Return the offsets (N,) after turning the right camera by these angles, radians."""
        rows = _turned_rows(self.camera, self.right_px, pitch_roll, yaw)
        return np.asarray(rows - self.left_px[:, 1], dtype=np.float64)


def _too_few(matches: _Matches) -> RefinementRefusal | None:
    count = len(matches.left_px)
    if count >= _MIN_MATCHES:
        return None
    return RefinementRefusal(
        f"{matches.pairs} pair{'' if matches.pairs == 1 else 's'} of images gave {count} "
        f"matches between left and right, but {_MIN_MATCHES} are needed: point the cameras at "
        "a scene with more texture"
    )


def _too_narrow(matches: _Matches) -> RefinementRefusal | None:
    width = matches.camera.width
    low, high = np.quantile(matches.left_px[:, 0], [0.05, 0.95])
    if high - low >= _MIN_SPREAD * width:
        return None
    return RefinementRefusal(
        f"90 % of the matches lie within {100 * (high - low) / width:.0f} % of the "
        f"image's width, but {100 * _MIN_SPREAD:.0f} % is needed to tell roll from pitch: "
        "point the cameras at a scene with texture on the left and on the right"
    )


def _aligning_turn(matches: _Matches, yaw: float) -> Float64Array:
    """(2,) radians: pitch and roll of the right camera that align the rows best."""

    def offsets(turn: Float64Array) -> Float64Array:
        return matches.turned_row_offsets(turn, yaw)

    fit = least_squares(offsets, np.zeros(2), loss="soft_l1", f_scale=_SOFT_PX, x_scale=1e-4)
    return np.asarray(fit.x, dtype=np.float64)


def _implausible(turn: Float64Array) -> RefinementRefusal | None:
    if np.abs(turn).max() <= _MAX_TURN_RAD:
        return None
    pitch, roll = (format_number(each, 2, signed=True) for each in np.degrees(turn).tolist())
    return RefinementRefusal(
        f"the epipolar error calls for a correction of {pitch}° in pitch and {roll}° "
        f"in roll, more than the {np.degrees(_MAX_TURN_RAD):g}° of a plausible drift: "
        "recalibrate, and check that left and right are synchronized"
    )


def _too_uncertain(camera: StereoCamera, std: Float64Array) -> RefinementRefusal | None:
    # What each means in pixels: pitch everywhere, roll at the left and right edge.
    pitch_px, roll_px = std * (camera.fy, camera.width / 2)
    if max(pitch_px, roll_px) <= _MAX_STD_PX:
        return None
    return RefinementRefusal(
        f"the matches determine pitch only to ± {half_95(pitch_px):.2f} px and roll to ± "
        f"{half_95(roll_px):.2f} px (95 % intervals), but ± {half_95(_MAX_STD_PX):.2g} px is "
        "needed: point the cameras at a static scene with more texture"
    )


def with_turned_right_camera(
    calibration: StereoCalibration, rectification: Rectification, turn: Float64Array
) -> StereoCalibration:
    """Return the calibration whose rectified right image is turned by a small rotation.

    With W the rotation of the vector ``turn`` and R1 that of the rectified left camera, the
    rectified right one is at ``W R1 R^T`` instead of ``R1 R^T``. So ``R' = R R1^T W^T R1`` and
    ``T' = R R1^T W^T (-B, 0, 0)``: left camera, right camera's position and lenses stay. A camera
    that converges by v more than calibrated sees ``(x, y, 1)`` at ``W_y(v) (x, y, 1)``, about
    ``f v (1 + x^2)`` pixels too far right; the turn (0, -v, 0) undoes that.

    Args:
        rectification: of the calibration.
        turn: (3,) rotation vector, radians, rectified right camera's axes.
    """
    R1 = rectification.R_rectified_left
    W = Rotation.from_rotvec(turn).as_matrix()
    R_right_rectified = calibration.R @ R1.T @ W.T
    return replace(
        calibration,
        R=R_right_rectified @ R1,
        T=R_right_rectified @ np.array([-rectification.camera.baseline, 0, 0]),
    )


def matched_points(left: Image, right: Image) -> tuple[Float64Array, Float64Array]:
    """Sub-pixel positions (N, 2) of one scene point each in a rectified pair.

    Corners (Shi-Tomasi) are tracked from left to right and back (Lucas-Kanade in two dimensions,
    so that a vertical offset shows); those that do not return to their start are dropped.
    """
    left, right = as_gray(left), as_gray(right)
    found = cv2.goodFeaturesToTrack(left, 1000, 0.005, 7)
    # OpenCV returns None if there is no corner, which its type stubs do not know.
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


def _quantiles(distances: Float64Array) -> tuple[float, float]:
    """Median and 95th percentile of the absolute values."""
    median, p95 = np.quantile(np.abs(distances), [0.5, 0.95]).tolist()
    return median, p95


def _turned_rows(
    camera: StereoCamera, px: Float64Array, pitch_roll: Float64Array, yaw: float
) -> Float64Array:
    """Rows (N,) of the pixels (N, 2) after turning the camera by pitch and roll, and by yaw."""
    level = (px - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    rays = np.column_stack([level, np.ones(len(px))])
    turn = Rotation.from_rotvec([pitch_roll[0], yaw, pitch_roll[1]]).as_matrix()
    turned = rays @ turn.T
    return np.asarray(turned[:, 1] / turned[:, 2] * camera.fy + camera.cy, dtype=np.float64)


def _deviations(matches: _Matches, turn: Float64Array, yaw: float) -> Float64Array:
    """(2,) radians: one standard deviation of pitch and roll.

    The sandwich estimator with the image's cells as clusters (Liang and Zeger, Biometrika 1986):
    an error that a cell has in common over all pairs counts once.
    """
    camera, right_px = matches.camera, matches.right_px
    errors = matches.turned_row_offsets(turn, yaw)
    step = 1e-6
    rows = _turned_rows(camera, right_px, turn, yaw)
    J = np.column_stack(
        [
            (_turned_rows(camera, right_px, turn + step * axis, yaw) - rows) / step
            for axis in np.eye(2)
        ]
    )
    # The slope of soft_l1, with which the fit weights each match.
    weight = 1 / np.sqrt(1 + (errors / _SOFT_PX) ** 2)
    # The curvature is smaller than the weight where an error counts only linearly.
    bread = np.linalg.inv((J * (weight**3)[:, None]).T @ J + 1e-9 * np.eye(2))
    score = J * (weight * errors)[:, None]
    cells = _cells(camera, matches.left_px)
    summed = np.zeros((_CELLS[0] * _CELLS[1], 2))
    np.add.at(summed, cells, score)
    used = np.unique(cells).size
    small = used / max(used - 2, 1)
    covariance = small * bread @ (summed.T @ summed) @ bread
    shared = _SHARED_PX / np.array([camera.fy, camera.width / 2])
    return np.asarray(np.hypot(np.sqrt(np.diag(covariance)), shared), dtype=np.float64)


def _cells(camera: StereoCamera, px: Float64Array) -> NDArray[np.intp]:
    share = px / (camera.width, camera.height)
    place = np.clip((share * _CELLS).astype(np.intp), 0, np.array(_CELLS) - 1)
    return np.asarray(place[:, 1] * _CELLS[0] + place[:, 0], dtype=np.intp)


def _coverage(camera: StereoCamera, px: Float64Array) -> float:
    counts = np.bincount(_cells(camera, px), minlength=_CELLS[0] * _CELLS[1])
    return float(np.mean(counts >= _MIN_IN_CELL))
