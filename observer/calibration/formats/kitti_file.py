"""KITTI's calibration files: ``calib.txt`` (odometry) and ``calib_cam_to_cam.txt`` (raw).

Cameras 0 and 1 are the grey pair, 2 and 3 the colour one; formats: the development kits'
readme.txt.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from observer.calibration.formats.numbers import at_key, image_size, shaped
from observer.calibration.formats.plain_data import CALIBRATION, calibration_errors
from observer.calibration.formats.understanding import (
    Cameras,
    Choice,
    Draft,
    DraftCamera,
    Size,
    Wanted,
    size_words,
)
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array
from observer.text_files import read_text

_LEFT_CAMERA: dict[Cameras, int] = {"grey": 0, "colour": 2}


@calibration_errors()
def read_kitti_odometry(path: Path, left: int, width: int, height: int) -> StereoCalibration:
    """The calibration of cameras ``left`` and ``left + 1``, whose images are rectified.

    Args:
        path: ``calib.txt`` with P0 to P3.
        left: 0 (grey) or 2 (colour).
        width, height: the images' size, which is not in the file.
    """
    file = _KittiFile(path.name, read_text(path, CALIBRATION))
    return file.rectified(f"P{left}", f"P{left + 1}", (width, height)).calibration()


@calibration_errors()
def read_kitti_raw(path: Path, left: int, width: int, height: int) -> StereoCalibration:
    """The calibration of cameras ``left`` and ``left + 1`` that fits images of this size.

    Images of size ``S`` are unrectified (K, D, R, T); those of size ``S_rect``, as in the
    ``_sync`` downloads, are rectified already (P_rect).
    """
    file = _KittiFile(path.name, read_text(path, CALIBRATION))
    return file.of_raw(left, (width, height)).calibration()


def kitti_odometry_draft(name: str, text: str, wanted: Wanted) -> Draft:
    """The calibration of an odometry ``calib.txt``."""
    file = _KittiFile(name, text)
    left, notes, choices = file.cameras(wanted.cameras, "P{}")
    if wanted.size is None:
        raise CalibrationError(
            f"{name}: a KITTI odometry calib.txt does not contain the image size; specify it "
            "(image_width and image_height, 1241x376 in sequence 00)"
        )
    notes.append(f"the file does not contain the image size; {size_words(wanted.size)} is assumed")
    draft = file.rectified(f"P{left}", f"P{left + 1}", wanted.size)
    return replace(
        draft,
        format="KITTI odometry calib.txt",
        size_is_given=True,
        notes=(*notes, *draft.notes),
        choices=tuple(choices),
    )


def kitti_raw_draft(name: str, text: str, wanted: Wanted) -> Draft:
    """The calibration of a raw ``calib_cam_to_cam.txt``.

    Without a wanted size it is that of the images before rectification.
    """
    file = _KittiFile(name, text)
    left, notes, choices = file.cameras(wanted.cameras, "S_0{}")
    keys = f"S_{left:02d}", f"S_rect_{left:02d}"
    # If both are missing, reading the first says so.
    sizes = [file.size(key) for key in keys if key in file.texts] or [file.size(keys[0])]
    size = wanted.size or sizes[0]
    if len(sizes) > 1:
        choices.append(Choice("size", tuple(map(size_words, sizes)), size_words(size)))
    draft = file.of_raw(left, size)
    return replace(draft, notes=(*notes, *draft.notes), choices=tuple(choices))


class _KittiFile:
    """Lines of ``key: numbers``."""

    def __init__(self, name: str, text: str) -> None:
        self._name = name
        entries = (line.partition(":") for line in text.splitlines())
        self.texts = {key.strip(): value for key, colon, value in entries if colon}

    def numbers(self, key: str, *shape: int) -> Float64Array:
        count = math.prod(shape)
        flat = at_key(self.texts, key, lambda text: shaped(text, count), self._name)
        return flat.reshape(shape)

    def size(self, key: str) -> Size:
        return at_key(self.texts, key, image_size, self._name)

    def cameras(self, wanted: Cameras | None, key: str) -> tuple[int, list[str], list[Choice]]:
        """Return the left camera of the pair to use, with notes and the choices the file offers."""
        there: list[Cameras] = [
            pair
            for pair, left in _LEFT_CAMERA.items()
            if key.format(left) in self.texts and key.format(left + 1) in self.texts
        ]
        taken: Cameras = wanted or (there[0] if there else "grey")
        left = _LEFT_CAMERA[taken]
        choices = [Choice("cameras", tuple(there), taken)] if len(there) > 1 else []
        return left, [f"cameras {left} and {left + 1} ({taken}) are used"], choices

    def of_raw(self, left: int, size: Size) -> Draft:
        a, b = f"{left:02d}", f"{left + 1:02d}"
        raw = self.size(f"S_{a}"), self.size(f"S_{b}")
        if raw == (size, size):
            return self._unrectified(a, b, size)
        if self.size(f"S_rect_{a}") == size:
            return self.rectified(f"P_rect_{a}", f"P_rect_{b}", size)
        raise CalibrationError(
            f"{self._name}: the images are {size_words(size)} pixels, which matches neither S_{a} "
            f"({size_words(raw[0])}) nor S_rect_{a} in the file"
        )

    def rectified(self, left: str, right: str, size: Size) -> Draft:
        P_left, P_right = self.numbers(left, 3, 4), self.numbers(right, 3, 4)
        if P_left[0, 0] <= 0 or not np.array_equal(P_left[:, :3], P_right[:, :3]):
            raise CalibrationError(
                f"{self._name}: {left} and {right} must share one camera matrix with a positive "
                "focal length, as for rectified images"
            )
        # P[0, 3] is f times the offset from camera 0, which cameras 2 and 3 both have.
        baseline = (P_left[0, 3] - P_right[0, 3]) / P_left[0, 0]
        return Draft(
            self._name,
            "KITTI raw calib_cam_to_cam.txt",
            DraftCamera(size, P_left[:, :3], np.zeros(5), K_key=left),
            DraftCamera(size, P_left[:, :3], np.zeros(5), K_key=right),
            np.eye(3),
            np.array([-baseline, 0.0, 0.0]),
            derived={"T": f"{left} and {right}"},
            notes=(f"the images are already rectified: baseline from {left} and {right}",),
        )

    def _unrectified(self, a: str, b: str, size: Size) -> Draft:
        R_a, R_b = (self.numbers(f"R_{c}", 3, 3) for c in (a, b))
        # R_x and T_x map camera 0's coordinates into camera x.
        R = R_b @ R_a.T
        left, right = (
            DraftCamera(
                size,
                self.numbers(f"K_{c}", 3, 3),
                self.numbers(f"D_{c}", 5),
                K_key=f"K_{c}",
                D_key=f"D_{c}",
            )
            for c in (a, b)
        )
        return Draft(
            self._name,
            "KITTI raw calib_cam_to_cam.txt",
            left,
            right,
            R,
            self.numbers(f"T_{b}", 3) - R @ self.numbers(f"T_{a}", 3),
            derived={"R": f"R_{a} and R_{b}", "T": f"T_{a} and T_{b}"},
            notes=("for the images before rectification (S, K, D, R and T)",),
        )
