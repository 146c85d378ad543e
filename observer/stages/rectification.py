"""From two images of a calibrated pair to the rectified pair that all other stages work on."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.geometry import Float64Array
from observer.types import Image

# cv2.initUndistortRectifyMap's pair of maps: (H, W, 2) int16 and (H, W) uint16.
_Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]


class Rectification:
    """Remaps a pair so that one scene point lies in the same row of both images.

    Bouguet's method as in OpenCV's ``stereoRectify``, at the input's size with alpha 0: every
    pixel of the result comes from a pixel of the input. Images of a calibration that is rectified
    already are handed through untouched.

    Attributes:
        camera: the rectified pair.
        R_rectified_left: (3, 3) rotation from the left camera's own frame into the rectified
            left camera's, which is the **camera** frame everywhere else.

    Raises:
        CalibrationError: the right camera does not stand to the right of the left one, or the
            calibration leaves no common view.
    """

    camera: StereoCamera
    R_rectified_left: Float64Array

    def __init__(self, calibration: StereoCalibration) -> None:
        self._calibration = calibration
        self._maps: tuple[_Maps, _Maps] | None = None
        _check_side_by_side(calibration)
        if calibration.is_rectified:
            K = calibration.K1
            self.camera = _camera(calibration, K, calibration.baseline)
            self.R_rectified_left = np.eye(3)
            return
        size = (calibration.width, calibration.height)
        rotations_and_projections = cv2.stereoRectify(
            calibration.K1,
            _distortion(calibration.D1),
            calibration.K2,
            _distortion(calibration.D2),
            size,
            calibration.R,
            calibration.T.reshape(3, 1),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=0,
            newImageSize=size,
        )
        R1, R2, P1, P2 = (
            np.asarray(matrix, dtype=np.float64) for matrix in rotations_and_projections[:4]
        )
        self._check_result(P1, P2)
        self.camera = _camera(calibration, P1, float(-P2[0, 3] / P2[0, 0]))
        self.R_rectified_left = R1
        self._maps = (
            _maps(calibration.K1, calibration.D1, R1, P1, size),
            _maps(calibration.K2, calibration.D2, R2, P2, size),
        )
        for name, maps in zip(("D1", "D2"), self._maps, strict=True):
            if not _is_one_view(maps[0], size):
                raise CalibrationError(
                    f"this calibration cannot be rectified: with {name} the image would fold over "
                    f"or leave its frame; check that K1, D1, K2 and D2 belong to "
                    f"{size[0]}x{size[1]} images of these cameras"
                )

    def apply(self, left: Image, right: Image) -> tuple[Image, Image]:
        """The rectified pair: same sizes and channels as the input.

        Args:
            left, right: (H, W) grey or (H, W, 3) BGR uint8 of the calibration's size.

        Raises:
            CalibrationError: an image is not of the size the calibration was made for.
        """
        for name, image in (("left", left), ("right", right)):
            height, width = image.shape[:2]
            if (width, height) != (self._calibration.width, self._calibration.height):
                raise CalibrationError(
                    f"the {name} image is {width}x{height} pixels, but the calibration is for "
                    f"{self._calibration.width}x{self._calibration.height}; use the calibration "
                    f"made at the images' size"
                )
        if self._maps is None:
            return left, right
        return _remap(left, self._maps[0]), _remap(right, self._maps[1])

    def _check_result(self, P1: Float64Array, P2: Float64Array) -> None:
        focal = float(P1[0, 0])
        usual = float(self._calibration.K1[0, 0])
        # Coefficients that belong to another lens or size make alpha 0 zoom into (or out to)
        # nothing.
        if not (
            np.isfinite(P1).all()
            and np.isfinite(P2).all()
            and usual / 5 < focal < usual * 5
            and P2[0, 3] < 0
            and P2[1, 3] == 0
        ):
            raise CalibrationError(
                f"this calibration cannot be rectified: the focal length would go from "
                f"{usual:.4g} to {focal:.4g} pixels; check that K1, D1, K2, D2 and R belong to "
                f"{self._calibration.width}x{self._calibration.height} images of these cameras"
            )


def _check_side_by_side(calibration: StereoCalibration) -> None:
    # The right camera's centre in the left camera's frame; T itself is in the right camera's.
    x, y, z = -calibration.R.T @ calibration.T
    if abs(x) <= max(abs(y), abs(z)):
        raise CalibrationError(
            f"T places the right camera {x:.3g} m to the right, {y:.3g} m below and {z:.3g} m in "
            f"front of the left one; the cameras must stand side by side"
        )
    if x < 0:
        raise CalibrationError(
            f"T places the right camera {-x:.3g} m to the left of the left one (T[0] must be "
            f"negative); swap left and right, or calibrate them in this order"
        )


def _camera(calibration: StereoCalibration, K: Float64Array, baseline: float) -> StereoCamera:
    return StereoCamera(
        width=calibration.width,
        height=calibration.height,
        fx=float(K[0, 0]),
        fy=float(K[1, 1]),
        cx=float(K[0, 2]),
        cy=float(K[1, 2]),
        baseline=baseline,
    )


def _distortion(D: Float64Array) -> Float64Array:
    return D if D.size else np.zeros(5)


def _maps(
    K: Float64Array, D: Float64Array, R: Float64Array, P: Float64Array, size: tuple[int, int]
) -> _Maps:
    # Fixed point maps: a third of the memory of float maps, and remap is about twice as fast.
    fixed, fraction = cv2.initUndistortRectifyMap(K, _distortion(D), R, P, size, cv2.CV_16SC2)
    return np.asarray(fixed, dtype=np.int16), np.asarray(fraction, dtype=np.uint16)


def _is_one_view(fixed: NDArray[np.int16], size: tuple[int, int]) -> bool:
    """Whether a map takes its pixels from inside the image, neighbours from neighbours."""
    # Every 16th pixel shows a fold. alpha 0 rests on a grid of 9 x 9 points, hence the margin.
    u, v = fixed[::16, ::16, 0].astype(int), fixed[::16, ::16, 1].astype(int)
    margin = 0.02 * max(size)
    inside = (u > -margin) & (u < size[0] + margin) & (v > -margin) & (v < size[1] + margin)
    return bool(inside.all() and (np.diff(u, axis=1) > 0).all() and (np.diff(v, axis=0) > 0).all())


def _remap(image: Image, maps: _Maps) -> Image:
    return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)
