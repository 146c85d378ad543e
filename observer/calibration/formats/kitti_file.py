"""KITTI's calibration files: ``calib.txt`` (odometry) and ``calib_cam_to_cam.txt`` (raw)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from observer.calibration.formats.plain_data import read_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array


def read_kitti_odometry(path: Path, left: int, width: int, height: int) -> StereoCalibration:
    """The calibration of cameras ``left`` and ``left + 1``, whose images are rectified.

    Args:
        path: ``calib.txt`` with P0 to P3.
        left: 0 (grey) or 2 (colour).
        width, height: the images' size, which the file does not tell.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    file = _KittiFile(path)
    return file.rectified(f"P{left}", f"P{left + 1}", width, height)


def read_kitti_raw(path: Path, left: int, width: int, height: int) -> StereoCalibration:
    """The calibration of cameras ``left`` and ``left + 1`` that fits images of this size.

    Images of size ``S`` are unrectified (K, D, R, T); those of size ``S_rect``, as in the
    ``_sync`` downloads, are rectified already (P_rect).

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    file = _KittiFile(path)
    a, b = f"{left:02d}", f"{left + 1:02d}"
    size = (width, height)
    raw = file.size(f"S_{a}"), file.size(f"S_{b}")
    if raw == (size, size):
        return file.unrectified(a, b, width, height)
    if file.size(f"S_rect_{a}") == size:
        return file.rectified(f"P_rect_{a}", f"P_rect_{b}", width, height)
    raise CalibrationError(
        f"{path.name}: the images are {width}x{height} pixels, which is neither the size S_{a} "
        f"({raw[0][0]}x{raw[0][1]}) nor S_rect_{a} that the file was made for"
    )


class _KittiFile:
    """Lines of ``key: numbers``."""

    def __init__(self, path: Path) -> None:
        self._name = path.name
        text = read_text(path)
        entries = (line.partition(":") for line in text.splitlines())
        self._texts = {key.strip(): value for key, colon, value in entries if colon}

    def numbers(self, key: str, count: int) -> Float64Array:
        if key not in self._texts:
            raise CalibrationError(f"{self._name}: {key} is missing")
        words = self._texts[key].split()
        if len(words) != count:
            raise CalibrationError(
                f"{self._name}: {key} must hold {count} numbers, not {len(words)}"
            )
        try:
            values = [float(word) for word in words]
        except ValueError:
            raise CalibrationError(f"{self._name}: {key} must hold numbers only") from None
        if not all(map(math.isfinite, values)):
            raise CalibrationError(f"{self._name}: {key} must hold finite numbers only")
        return np.array(values)

    def size(self, key: str) -> tuple[int, int]:
        width, height = self.numbers(key, 2)
        return int(width), int(height)

    def rectified(self, left: str, right: str, width: int, height: int) -> StereoCalibration:
        P_left = self.numbers(left, 12).reshape(3, 4)
        P_right = self.numbers(right, 12).reshape(3, 4)
        if P_left[0, 0] <= 0 or not np.array_equal(P_left[:, :3], P_right[:, :3]):
            raise CalibrationError(
                f"{self._name}: {left} and {right} must have one camera matrix with a positive "
                f"focal length, as rectified images have"
            )
        # P[3] is f times the way from camera 0, and cameras 2 and 3 both stand beside it.
        baseline = (P_left[0, 3] - P_right[0, 3]) / P_left[0, 0]
        return self._checked(
            width, height, P_left[:, :3], np.zeros(5), P_left[:, :3], np.zeros(5), np.eye(3),
            np.array([-baseline, 0.0, 0.0]),
        )  # fmt: skip

    def unrectified(self, a: str, b: str, width: int, height: int) -> StereoCalibration:
        R_a, R_b = (self.numbers(f"R_{c}", 9).reshape(3, 3) for c in (a, b))
        T_a, T_b = (self.numbers(f"T_{c}", 3) for c in (a, b))
        # R_x and T_x map camera 0's coordinates into camera x.
        R = R_b @ R_a.T
        return self._checked(
            width, height,
            self.numbers(f"K_{a}", 9), self.numbers(f"D_{a}", 5),
            self.numbers(f"K_{b}", 9), self.numbers(f"D_{b}", 5),
            R, T_b - R @ T_a,
        )  # fmt: skip

    def _checked(
        self,
        width: int,
        height: int,
        K1: Float64Array,
        D1: Float64Array,
        K2: Float64Array,
        D2: Float64Array,
        R: Float64Array,
        T: Float64Array,
    ) -> StereoCalibration:
        try:
            return StereoCalibration(width, height, K1, D1, K2, D2, R, T)
        except CalibrationError as error:
            raise CalibrationError(f"{self._name}: {error}") from None
