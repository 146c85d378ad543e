"""Rectification of a calibrated pair's images, for all other stages."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.geometry import Float64Array
from observer.types import Image

# cv2.initUndistortRectifyMap's pair of maps: (H, W, 2) int16 and (H, W) uint16.
_Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]

# Largest half field of view of the rectified image: a perspective image of a fisheye lens grows
# without bound, and gets ever blurrier, towards 90 degrees.
_WIDEST_HALF_VIEW_RAD = np.deg2rad(60.0)
# Maps have steps of 1/32 px: this far inside the frame no pixel is interpolated with the outside.
_FRAME_MARGIN_PX = 0.05
# Pixels: how exactly a rectified point must project back to its original pixel.
_POINT_TOLERANCE_PX = 0.01


class Rectification:
    """Remaps a pair so that one scene point lies in the same row of both images.

    Bouguet's method as in OpenCV's ``stereoRectify``, at the input's size with alpha 0: every
    pixel of the result comes from a pixel of the input. Images of an already rectified calibration
    are passed through unchanged. Fisheye images are rotated in the same way; they become
    perspective images of the widest view that both cameras fill, at most 120 degrees across.

    Attributes:
        camera: the rectified pair.
        R_rectified_left: (3, 3) rotation from the left camera's own frame into the rectified
            left camera's, which is the **camera** frame everywhere else.
        R_rectified_right: (3, 3) the same for the right camera.

    Raises:
        CalibrationError: the right camera does not stand to the right of the left one, or the
            calibration leaves no common view.
    """

    camera: StereoCamera
    R_rectified_left: Float64Array
    R_rectified_right: Float64Array

    def __init__(self, calibration: StereoCalibration) -> None:
        c = self._calibration = calibration
        self._fisheye = c.distortion_model == "equidistant"
        # K and D of the left and of the right camera.
        self._lenses = ((c.K1, _distortion(c.D1)), (c.K2, _distortion(c.D2)))
        self._maps: tuple[_Maps, _Maps] | None = None
        calibration.check_side_by_side()
        if calibration.is_rectified:
            self.camera = _camera(calibration, c.K1, calibration.baseline)
            self.R_rectified_left = self.R_rectified_right = np.eye(3)
            return
        size = (calibration.width, calibration.height)
        R1, R2, P1, P2 = self._rotations_and_projections(size)
        self.camera = _camera(calibration, P1, float(-P2[0, 3] / P2[0, 0]))
        self.R_rectified_left, self.R_rectified_right = R1, R2
        left, right = self._lenses
        self._maps = self._map(*left, R1, P1, size), self._map(*right, R2, P2, size)
        for name, maps in zip(("D1", "D2"), self._maps, strict=True):
            if not _is_one_view(maps[0], size):
                raise CalibrationError(
                    f"this calibration cannot be rectified: with {name} the image would fold over "
                    "or leave its frame; check that K1, D1, K2 and D2 belong to "
                    f"{size[0]}x{size[1]} images of these cameras"
                )

    def apply(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Return the rectified pair, with sizes and channels as the input.

        Args:
            left, right: (H, W) grey or (H, W, 3) BGR uint8 of the calibration's size.

        Raises:
            CalibrationError: an image is not of the size the calibration was made for.
        """
        self._check_size("left", left)
        self._check_size("right", right)
        if self._maps is None:
            return left, right
        return _remap(left, self._maps[0]), _remap(right, self._maps[1])

    def apply_left(self, left: Image) -> Image:
        """Return the rectified left image alone, as ``apply`` does.

        Raises:
            CalibrationError: it is not of the size the calibration was made for.
        """
        self._check_size("left", left)
        return left if self._maps is None else _remap(left, self._maps[0])

    def _check_size(self, name: str, image: Image) -> None:
        height, width = image.shape[:2]
        if (width, height) != (self._calibration.width, self._calibration.height):
            raise CalibrationError(
                f"the {name} image is {width}x{height} pixels, but the calibration is for "
                f"{self._calibration.width}x{self._calibration.height}; use the calibration "
                "made at this image size"
            )

    def rectify_points(
        self, left_px: ArrayLike, right_px: ArrayLike
    ) -> tuple[Float64Array, Float64Array]:
        """Map pixels of the original images to the rectified ones: (N, 2) and (M, 2).

        The results may lie outside the rectified images.

        Args:
            left_px, right_px: (N, 2) and (M, 2) pixels of the left and of the right image.

        Returns:
            Pixels of the rectified images; NaN where the ray does not point forwards from the
            rectified camera, or the lens model is not valid that far out.
        """
        left, right = self._lenses
        return (
            self._rectified_points(*left, self.R_rectified_left, left_px),
            self._rectified_points(*right, self.R_rectified_right, right_px),
        )

    def _rectified_points(
        self, K: Float64Array, D: Float64Array, R: Float64Array, px: ArrayLike
    ) -> Float64Array:
        given = np.array(px, dtype=np.float64).reshape(-1, 2)
        if self._maps is None or not len(given):
            return given
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-9)
        finite = np.asarray(np.isfinite(given).all(axis=1), dtype=np.bool_)
        points = np.where(finite.reshape(-1, 1), given, 0.0).reshape(-1, 1, 2)
        undistort = cv2.fisheye.undistortPoints if self._fisheye else cv2.undistortPointsIter
        # In the original camera's frame, so that rays behind the rectified camera can be detected.
        plane = undistort(points, K, D, R=np.eye(3), P=np.eye(3), criteria=criteria)
        rays = np.ones((len(given), 3))
        rays[:, :2] = np.asarray(plane, dtype=np.float64).reshape(-1, 2)
        came_from = (
            fisheye_pixels(rays, K, D)
            if self._fisheye
            else cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
        )
        turned = rays @ R.T
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            good = finite & (turned[:, 2] > 0)
            good &= np.abs(came_from - given).max(axis=1) < _POINT_TOLERANCE_PX
            rectified = turned[:, :2] / turned[:, 2:] * [self.camera.fx, self.camera.fy]
        rectified += [self.camera.cx, self.camera.cy]
        rectified[~good] = np.nan
        return np.asarray(rectified, dtype=np.float64)

    def _rotations_and_projections(
        self, size: tuple[int, int]
    ) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """R1, R2, P1 and P2 as OpenCV's stereoRectify returns them, for equidistant lenses too.

        OpenCV's own ``fisheye.stereoRectify`` chooses the focal length from four pixels: the result
        leaves the frame at the corners, or uses far less of the images than possible. The rotations
        do not depend on the lens and are those of stereoRectify.
        """
        c, ((K1, D1), (K2, D2)) = self._calibration, self._lenses
        if self._fisheye:
            D1 = D2 = np.zeros(5)
        R1, R2, P1, P2 = (
            np.asarray(matrix, dtype=np.float64)
            for matrix in cv2.stereoRectify(
                *(K1, D1, K2, D2, size, c.R, c.T.reshape(3, 1)),
                flags=cv2.CALIB_ZERO_DISPARITY,
                alpha=0,
                newImageSize=size,
            )[:4]
        )
        if self._fisheye:
            P1[:, :3] = self._widest_common_view(R1, R2)
            P2 = P1.copy()
            P2[0, 3] = -P2[0, 0] * c.baseline
        self._check_result(P1, P2)
        return R1, R2, P1, P2

    def _widest_common_view(self, R1: Float64Array, R2: Float64Array) -> Float64Array:
        """(3, 3) camera matrix of the widest plane image that lies within both fisheye images."""
        calibration = self._calibration
        last = np.array([calibration.width - 1.0, calibration.height - 1.0])
        lenses = [(*lens, R) for lens, R in zip(self._lenses, (R1, R2), strict=True)]
        # The optical axis: the mean direction of the two image centres.
        axis = np.mean(
            [
                np.ravel(cv2.fisheye.undistortPoints((last / 2).reshape(1, 1, 2), K, D, R=R))
                for K, D, R in lenses
            ],
            axis=0,
        )
        across = np.linspace(-0.5, 0.5, 65)
        edge = np.full_like(across, 0.5)
        frame = last * np.concatenate(
            [np.column_stack(side) for side in (
                (across, -edge), (across, edge), (-edge, across), (edge, across),
            )]
        )  # fmt: skip

        def is_filled(focal: float) -> bool:
            rays = np.column_stack([frame / focal + axis, np.ones(len(frame))])
            for K, D, R in lenses:
                px = fisheye_pixels(rays @ R, K, D)
                # NaN, an invalid pixel, compares false.
                if not ((px >= _FRAME_MARGIN_PX) & (px <= last - _FRAME_MARGIN_PX)).all():
                    return False
            return True

        narrow, wide = (
            5.0 * calibration.K1[0, 0],
            float(last[0] / 2 / np.tan(_WIDEST_HALF_VIEW_RAD)),
        )
        if is_filled(wide):
            narrow = wide
        elif not is_filled(narrow):
            raise CalibrationError(
                f"this calibration cannot be rectified: turned by R, the two fisheye images share "
                f"no view; check that K1, D1, K2, D2 and R belong to "
                f"{calibration.width}x{calibration.height} images of these cameras"
            )
        # Bisect until the two agree to a hundredth of a pixel at the image's edge.
        while narrow - wide > 1e-5 * wide:
            between = (narrow + wide) / 2
            narrow, wide = (between, wide) if is_filled(between) else (narrow, between)
        centre = last / 2 - narrow * axis
        return np.array([[narrow, 0, centre[0]], [0, narrow, centre[1]], [0, 0, 1.0]])

    def _map(
        self,
        K: Float64Array,
        D: Float64Array,
        R: Float64Array,
        P: Float64Array,
        size: tuple[int, int],
    ) -> _Maps:
        # Fixed point maps: a third of the memory of float maps, and remap is about twice as fast.
        module = cv2.fisheye if self._fisheye else cv2
        fixed, fraction = module.initUndistortRectifyMap(K, D, R, P, size, cv2.CV_16SC2)
        return np.asarray(fixed, dtype=np.int16), np.asarray(fraction, dtype=np.uint16)

    def _check_result(self, P1: Float64Array, P2: Float64Array) -> None:
        focal = float(P1[0, 0])
        usual = float(self._calibration.K1[0, 0])
        # With coefficients of another lens or image size, alpha 0 zooms in (or out) without limit.
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


def fisheye_pixels(rays: Float64Array, K: Float64Array, D: Float64Array) -> Float64Array:
    """Return pixels (N, 2) of rays (N, 3) in the camera's frame through an equidistant lens.

    theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) (Kannala and Brandt
    2006; OpenCV's module fisheye). NaN for rays that do not point forward, and where theta_d
    no longer grows with theta, so that two rays would share one pixel.
    """
    r = np.hypot(rays[:, 0], rays[:, 1])
    theta = np.arctan2(r, rays[:, 2])
    powers = theta[:, None] ** np.array([2.0, 4.0, 6.0, 8.0])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scale = np.where(r > 0, theta * (1 + powers @ D) / r, 1.0)
        grows = 1 + powers @ (D * [3.0, 5.0, 7.0, 9.0]) > 0
        px = rays[:, :2] * scale[:, None] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
    px[~(grows & (rays[:, 2] > 0))] = np.nan
    return np.asarray(px, dtype=np.float64)


def _is_one_view(fixed: NDArray[np.int16], size: tuple[int, int]) -> bool:
    """Return whether a map samples inside the image only and does not fold."""
    # Every 16th pixel is enough to see a fold. OpenCV computes alpha 0 on 9 x 9 points only, hence
    # the margin.
    u, v = fixed[::16, ::16, 0].astype(int), fixed[::16, ::16, 1].astype(int)
    margin = 0.02 * max(size)
    inside = (u > -margin) & (u < size[0] + margin) & (v > -margin) & (v < size[1] + margin)
    return bool(inside.all() and (np.diff(u, axis=1) > 0).all() and (np.diff(v, axis=0) > 0).all())


def _remap(image: Image, maps: _Maps) -> Image:
    return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)
