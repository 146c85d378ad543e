"""One lens: from directions to pixels with all derivatives, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from observer.camera import DistortionModel, StereoCalibration
from observer.geometry import Float64Array

# Number of distortion coefficients: k1 k2 p1 p2 k3, or k1 k2 k3 k4 of a fisheye lens.
DISTORTION_SIZE: dict[DistortionModel, int] = {"radtan": 5, "equidistant": 4}

# Distortion is inverted iteratively; OpenCV's default limits leave tenths of a pixel in corners.
_CRITERIA = (cv2.TERM_CRITERIA_MAX_ITER + cv2.TERM_CRITERIA_EPS, 60, 1e-10)
# Metres: points nearer to the plane of the lens than this have no image.
_LEAST_DEPTH_M = 1e-6


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera's intrinsic parameters as one vector, as an adjustment needs them.

    Attributes:
        model: of the distortion.
        values: (4 + N,) fx fy cx cy and the distortion, pixels and plain numbers.
    """

    model: DistortionModel
    values: Float64Array

    @staticmethod
    def ideal(model: DistortionModel, focal_px: float, width: int, height: int) -> Lens:
        """Return a lens without distortion, its axis through the image's centre."""
        centre = [(width - 1) / 2, (height - 1) / 2]
        bent = np.zeros(DISTORTION_SIZE[model])
        return Lens(model, np.concatenate([[focal_px, focal_px], centre, bent]))

    @property
    def K(self) -> Float64Array:
        """(3, 3) camera matrix."""
        fx, fy, cx, cy = self.values[:4].tolist()
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    @property
    def D(self) -> Float64Array:
        """(N,) distortion."""
        return self.values[4:]

    def project(self, points: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Project points (N, 3), the lens's own frame, metres.

        Returns:
            (N, 2) pixels, NaN for points not in front of the lens; (N, 2, 3) their derivatives
            by the point, px/m; and (N, 2, 4 + N) those by ``values``.
        """
        if len(points) == 0:
            return np.zeros((0, 2)), np.zeros((0, 2, 3)), np.zeros((0, 2, len(self.values)))
        at_rest = np.zeros(3)
        front = points[:, 2] > _LEAST_DEPTH_M
        seen = np.where(front[:, None], points, [0.0, 0.0, 1.0]).reshape(-1, 1, 3)
        # With an identity pose, the derivative by the camera's translation equals that by the
        # point.
        if self.model == "equidistant":
            px, J = cv2.fisheye.projectPoints(seen, at_rest, at_rest, self.K, self.D)
            by_lens, by_point = J[:, :8], J[:, 11:14]
        else:
            px, J = cv2.projectPoints(seen, at_rest, at_rest, self.K, self.D)
            by_lens, by_point = J[:, 6:], J[:, 3:6]
        out = np.asarray(px, dtype=np.float64).reshape(-1, 2).copy()
        out[~front] = np.nan
        count = len(points)
        return (
            out,
            np.asarray(by_point, dtype=np.float64).reshape(count, 2, 3),
            np.asarray(by_lens, dtype=np.float64).reshape(count, 2, -1),
        )

    def directions(self, px: Float64Array) -> Float64Array:
        """(N, 3) viewing directions with z = 1 of pixels (N, 2); NaN where there is none."""
        return directions(self.model, self.K, self.D, px)


def directions(
    model: DistortionModel, K: Float64Array, D: Float64Array, px: Float64Array
) -> Float64Array:
    """(N, 3) directions with z = 1, the lens's own frame, of pixels (N, 2); NaN where none.

    Args:
        D: (N,) coefficients, or none for an ideal lens.
    """
    if len(px) == 0:
        return np.zeros((0, 3))
    D = D if D.size else np.zeros(5)
    given = np.ascontiguousarray(px, dtype=np.float64).reshape(-1, 1, 2)
    if model == "equidistant":
        flat = cv2.fisheye.undistortPoints(given, K, D, criteria=_CRITERIA)
    else:
        # undistortPoints itself stops after five iterations, which are not enough.
        flat = cv2.undistortPointsIter(given, K, D, np.eye(3), np.eye(3), _CRITERIA)
    out = np.ones((len(px), 3))
    out[:, :2] = np.asarray(flat, dtype=np.float64).reshape(-1, 2)
    # OpenCV marks what a fisheye lens cannot see with -1e6.
    out[~(np.abs(out[:, :2]) < 1e5).all(axis=1)] = np.nan
    return out


def horizontal_field_of_view(calibration: StereoCalibration) -> float:
    """Return the angle, radians, that the left image spans along its middle row.

    Where the lens model is not valid up to both borders, its distortion is left out.
    """
    c = calibration
    row = (c.height - 1) / 2
    ends = np.array([[-0.5, row], [c.width - 0.5, row]])
    left, right = directions(c.distortion_model, c.K1, c.D1, ends)[:, 0].tolist()
    if left < right:
        return math.atan(right) - math.atan(left)
    share = c.width / float(c.K1[0, 0])
    return share if c.distortion_model == "equidistant" else 2 * math.atan(share / 2)
