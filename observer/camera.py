"""Models of the two cameras: as calibrated, and as one rectified pair."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.errors import CalibrationError
from observer.geometry import Float64Array, is_rotation

# Metres: a baseline outside these limits is almost certainly in other units.
MIN_BASELINE_M = 0.001
MAX_BASELINE_M = 2.0
# A square of a board is a few centimetres wide, and a baseline is seldom longer than 50 of them.
_MOST_SQUARES = 50.0
# Image sizes in pixels, in each direction.
MIN_IMAGE_PX, MAX_IMAGE_PX = 8, 16384
# Focal lengths as shares of the image's width: fields of view of 157 to 3 degrees without
# distortion.
FOCAL_SHARES = (0.1, 20.0)

# OpenCV's own model (k1 k2 p1 p2 [k3 ...], "radtan" to Kalibr, "plumb_bob" to ROS), and that of
# fisheye lenses (k1 k2 k3 k4; Kannala and Brandt 2006, OpenCV's module fisheye).
DistortionModel = Literal["radtan", "equidistant"]


@dataclass(frozen=True, eq=False)
class StereoCalibration:
    """A calibrated, not necessarily rectified, pair of cameras.

    Attributes:
        width, height: image size in pixels, the same for both cameras.
        K1, K2: (3, 3) float64 camera matrices, pixels.
        D1, D2: (N,) float64 distortion k1 k2 p1 p2 [k3 ...], for a fisheye lens k1 k2 k3 k4; all
            zero for rectified images.
        R: (3, 3) rotation ``R_right_left``.
        T: (3,) metres: the left camera's origin in the right camera's frame (T[0] < 0).
        distortion_model: of both lenses.

    Raises:
        CalibrationError: a value is invalid; the message names the key and the reason.
    """

    width: int
    height: int
    K1: Float64Array
    D1: Float64Array
    K2: Float64Array
    D2: Float64Array
    R: Float64Array
    T: Float64Array
    distortion_model: DistortionModel = "radtan"

    def __post_init__(self) -> None:
        if not all(MIN_IMAGE_PX <= size <= MAX_IMAGE_PX for size in (self.width, self.height)):
            raise CalibrationError(
                f"image_width and image_height must be between {MIN_IMAGE_PX} and {MAX_IMAGE_PX} "
                f"pixels, not {self.width} x {self.height}"
            )
        for name in ("K1", "K2", "R"):
            self._set(name, (3, 3))
        self._set("T", (3,))
        for name in ("D1", "D2"):
            size = np.asarray(getattr(self, name)).size
            if self.distortion_model == "equidistant":
                if size != 4:
                    raise CalibrationError(
                        f"{name} of an equidistant (fisheye) lens must contain 4 coefficients, "
                        f"not {size}"
                    )
            elif size not in (0, 4, 5, 8, 12, 14):
                raise CalibrationError(
                    f"{name} must contain 4, 5, 8, 12 or 14 distortion coefficients, not {size}"
                )
            self._set(name, (size,))
        for name in ("K1", "K2"):
            K = getattr(self, name)
            if K[0, 0] <= 0 or K[1, 1] <= 0 or abs(K[2, 2] - 1) > 1e-9:
                raise CalibrationError(
                    f"{name} must be a camera matrix with positive focal lengths and "
                    f"1 in its lower right corner"
                )
            self._check_focal(name, K)
        if not is_rotation(self.R):
            raise CalibrationError("R must be a rotation matrix (R^T R = I, det R = +1)")
        baseline = self.baseline
        if baseline == 0:
            raise CalibrationError("T must not be zero: the two cameras need a baseline")
        if not is_plausible_baseline(baseline):
            raise CalibrationError(
                f"T gives a baseline of {baseline:g} m, which is outside "
                f"{MIN_BASELINE_M:g} to {MAX_BASELINE_M:g} m{_unit_hint(baseline)}"
            )

    def __repr__(self) -> str:
        return (
            f"<calibration {self.width}x{self.height}, f {self.K1[0, 0]:.1f} px, "
            f"baseline {1000 * float(np.linalg.norm(self.T)):.1f} mm>"
        )

    def _check_focal(self, name: str, K: Float64Array) -> None:
        """Refuse focal lengths that no lens has.

        Raises:
            CalibrationError: names the focal lengths and their limits.
        """
        low, high = FOCAL_SHARES
        fx, fy = float(K[0, 0]), float(K[1, 1])
        if not (low * self.width <= fx <= high * self.width and 0.5 < fy / fx < 2):
            raise CalibrationError(
                f"{name} has the focal lengths {fx:.4g} and {fy:.4g} pixels, which no camera has "
                f"for images {self.width} pixels wide: they must be nearly the same, and between "
                f"{low * self.width:.4g} and {high * self.width:.4g}"
            )

    def _set(self, name: str, shape: tuple[int, ...]) -> None:
        try:
            value = np.array(getattr(self, name), dtype=np.float64)
        except (TypeError, ValueError):
            raise CalibrationError(f"{name} must be an array of numbers") from None
        if value.size != int(np.prod(shape)):
            raise CalibrationError(
                f"{name} must have shape {' x '.join(map(str, shape))}, "
                f"not {' x '.join(map(str, value.shape))}"
            )
        if not np.isfinite(value).all():
            raise CalibrationError(f"{name} must contain only finite numbers")
        value = value.reshape(shape)
        value.setflags(write=False)
        object.__setattr__(self, name, value)

    def check_side_by_side(self) -> None:
        """Refuse a right camera that is not to the right of the left one.

        Raises:
            CalibrationError: says where it is, and to swap the two if that helps.
        """
        # The right camera's centre in the left camera's frame; T itself is in the right camera's.
        x, y, z = -self.R.T @ self.T
        if abs(x) <= max(abs(y), abs(z)):
            raise CalibrationError(
                f"T places the right camera {x:.3g} m to the right of, {y:.3g} m below and {z:.3g} "
                "m in front of the left one; the cameras must be side by side"
            )
        if x < 0:
            raise CalibrationError(
                f"T places the right camera {-x:.3g} m to the left of the left one (T[0] must be "
                f"negative); swap left and right, or calibrate them in this order"
            )

    @property
    def baseline(self) -> float:
        """Distance between the two cameras' centres, metres."""
        return float(np.linalg.norm(self.T))

    @property
    def fb(self) -> float:
        """Focal length of the left camera times baseline, pixel metres: see ``StereoCamera.fb``."""
        return float(self.K1[0, 0]) * self.baseline

    @property
    def is_rectified(self) -> bool:
        """Return whether images of this pair can be used as they are, without remapping."""
        return bool(
            self.distortion_model == "radtan"
            and not self.D1.any()
            and not self.D2.any()
            and np.array_equal(self.R, np.eye(3))
            and not self.T[1:].any()
            and self.T[0] < 0
            and np.array_equal(self.K1, self.K2)
            and self.K1[0, 1] == 0
        )

    @staticmethod
    def rectified(
        width: int, height: int, fx: float, fy: float, cx: float, cy: float, baseline: float
    ) -> StereoCalibration:
        """Return the calibration of images that are already rectified."""
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)
        return StereoCalibration(
            width, height, K, np.zeros(5), K, np.zeros(5), np.eye(3), np.array([-baseline, 0, 0])
        )


def is_plausible_baseline(metres: float) -> bool:
    """Return whether two cameras may be this far apart."""
    return MIN_BASELINE_M <= metres <= MAX_BASELINE_M


def may_be_squares(baseline: float) -> bool:
    """Return whether a baseline that is too long for metres may be in squares of a board."""
    return MAX_BASELINE_M < baseline <= _MOST_SQUARES


def _unit_hint(baseline: float) -> str:
    """Return in which units this baseline would be plausible, as the rest of a sentence."""
    fitting = [
        f"if T is in {unit}, divide it by {divisor} ({baseline / divisor:.3g} m)"
        for unit, divisor in (("millimetres", 1000), ("centimetres", 100))
        if is_plausible_baseline(baseline / divisor)
    ]
    if may_be_squares(baseline):
        fitting.append(
            "if T is in squares of the board, multiply it by the side of a square in metres"
        )
    return f"; {'; or '.join(fitting)}" if fitting else ""


@dataclass(frozen=True)
class StereoCamera:
    """A rectified pair, as every stage after rectification needs it.

    Frame: the rectified left camera's optical frame, x right, y down, z forward, metres.
    Pixels: u right, v down, the centre of the upper left pixel is (0, 0).
    Disparity: u_left - u_right, pixels, positive for points in front of the camera.

    Attributes:
        width, height: image size, pixels.
        fx, fy: focal lengths, pixels.
        cx, cy: principal point of both rectified images, pixels.
        baseline: metres.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float

    @property
    def K(self) -> Float64Array:
        """(3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    @property
    def fb(self) -> float:
        """Focal length times baseline, pixel metres: depth times disparity of every point."""
        return self.fx * self.baseline

    @property
    def numbers(self) -> tuple[float, float, float, float, float]:
        """Focal lengths and principal point, pixels, and baseline, metres, as kernels take them."""
        return self.fx, self.fy, self.cx, self.cy, self.baseline

    @property
    def corner_px(self) -> float:
        """Distance of the image's farthest corner from the principal point, pixels."""
        across, down = max(self.cx, self.width - self.cx), max(self.cy, self.height - self.cy)
        return math.hypot(across, down)

    def triangulate(self, px: ArrayLike, disparity: ArrayLike) -> Float64Array:
        """Triangulate points (..., 3), camera frame, from pixels (..., 2) and disparities (...).

        A disparity that is not positive or not finite gives NaN, never a far point.
        """
        uv = np.asarray(px, dtype=np.float64)
        d = np.asarray(disparity, dtype=np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            z = np.where(d > 0, self.fb / d, np.nan)
        x = (uv[..., 0] - self.cx) / self.fx * z
        y = (uv[..., 1] - self.cy) / self.fy * z
        return np.stack([x, y, z], axis=-1)

    def project(self, points: ArrayLike) -> tuple[Float64Array, Float64Array]:
        """Project camera-frame points (..., 3) to pixels (..., 2) and disparities (...).

        Points that do not lie in front of the camera give NaN.
        """
        p = np.asarray(points, dtype=np.float64)
        z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
        u = self.fx * p[..., 0] / z + self.cx
        v = self.fy * p[..., 1] / z + self.cy
        return np.stack([u, v], axis=-1), self.fb / z

    def depth_sigma(self, depth: float, sigma_disparity: float) -> float:
        """Standard deviation of a depth Z by that of its disparity: Z^2 sigma_d / (f B), metres."""
        return depth**2 * sigma_disparity / self.fb

    def point_covariance(
        self, px: ArrayLike, disparity: ArrayLike, sigma_px: float, sigma_disparity: float
    ) -> Float64Array:
        """Covariance (N, 3, 3), m^2, of triangulated points, to first order.

        J diag(sigma_px^2, sigma_px^2, sigma_disparity^2) J^T with the Jacobian J of
        ``triangulate``; its depth part is that of ``depth_sigma``, squared
        (Franke et al., 6D-Vision, DAGM 2005).
        """
        uv = np.asarray(px, dtype=np.float64).reshape(-1, 2)
        d = np.asarray(disparity, dtype=np.float64).reshape(-1)
        fb = self.fb
        J = np.zeros((len(d), 3, 3))
        J[:, 0, 0] = self.baseline / d
        J[:, 0, 2] = -(uv[:, 0] - self.cx) * self.baseline / d**2
        J[:, 1, 1] = fb / (self.fy * d)
        J[:, 1, 2] = -(uv[:, 1] - self.cy) * fb / (self.fy * d**2)
        J[:, 2, 2] = -fb / d**2
        variances = np.array([sigma_px**2, sigma_px**2, sigma_disparity**2])
        return np.asarray((J * variances) @ J.transpose(0, 2, 1), dtype=np.float64)


def as_gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the luma (H, W) of a grey or BGR (H, W, 3) image; grey images are not copied."""
    if image.ndim == 2:
        return image
    import cv2

    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
