"""ROS ``camera_info`` files, as camera_calibration writes them: one for each camera.

Format: sensor_msgs/CameraInfo and camera_calibration_parsers. The transformation between the
cameras is not written down; it follows from both rectifications and the baseline in P.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.calibration.formats.numbers import (
    distortion_numbers,
    shaped_numbers,
    whole_number,
)
from observer.calibration.formats.plain_data import PlainData
from observer.calibration.formats.understanding import Draft, FileCamera, check_alike
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array, is_rotation

_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "plumb_bob": "radtan",
    "rational_polynomial": "radtan",
    # Drivers of cameras that rectify by themselves leave it out.
    "": "radtan",
    "none": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}


@dataclass(frozen=True, eq=False)
class _Camera(FileCamera):
    name: str
    camera_name: str
    R_rectified: Float64Array
    offset: float

    def is_called(self, side: str) -> bool:
        return side in f"{self.name} {self.camera_name}".lower()


def ros_draft(
    first: tuple[str, dict[str, PlainData]], second: tuple[str, dict[str, PlainData]]
) -> Draft:
    """The calibration of two ``camera_info`` files; the baseline in P tells which one is right.

    Args:
        first, second: name and top-level mapping of each file.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    a, b = _read_camera(*first), _read_camera(*second)
    left, right = (a, b) if b.offset <= a.offset else (b, a)
    if left.offset == right.offset:
        raise CalibrationError(
            f"{right.name}: projection_matrix has the same offset P[3] in both files, so there "
            f"is no baseline; calibrate the two cameras together as a stereo pair"
        )
    check_alike(
        left,
        right,
        name=right.name,
        size="image_width x image_height",
        model="distortion_model",
        other="the left camera's",
    )
    notes = [
        f"{left.name} is the left camera (projection_matrix)",
        "rotation and baseline follow from rectification_matrix and projection_matrix",
    ]
    if left.is_called("right") or right.is_called("left"):
        notes[0] += ", although the names say otherwise"
    # In the rectified frames the right camera stands at x = baseline:
    # R_right X_right = R_left X_left - (baseline, 0, 0).
    baseline = left.offset - right.offset
    return Draft(
        source=right.name,
        format="ROS camera_info of two cameras",
        size=left.size,
        K1=left.K,
        D1=left.D,
        K2=right.K,
        D2=right.D,
        R=right.R_rectified.T @ left.R_rectified,
        T=right.R_rectified.T @ np.array([-baseline, 0.0, 0.0]),
        distortion_model=left.model,
        keys={
            "K1": "camera_matrix of the left camera",
            "D1": "distortion_coefficients of the left camera",
            "K2": "camera_matrix",
            "D2": "distortion_coefficients",
        },
        derived={
            "R": "rectification_matrix of both cameras",
            "T": "rectification_matrix and projection_matrix of both cameras",
        },
        notes=tuple(notes),
    )


def _read_camera(name: str, data: dict[str, PlainData]) -> _Camera:
    for key in ("image_width", "image_height"):
        if key not in data:
            raise CalibrationError(f"{name}: {key} is missing")
    size = (
        whole_number(data["image_width"], key="image_width", name=name),
        whole_number(data["image_height"], key="image_height", name=name),
    )
    model = data.get("distortion_model", "plumb_bob")
    if not isinstance(model, str) or model not in _DISTORTION_MODELS:
        raise CalibrationError(
            f"{name}: distortion_model must be plumb_bob, rational_polynomial or equidistant, "
            f"not {str(model)[:40]!r}"
        )
    K = shaped_numbers(data, "camera_matrix", (3, 3), name=name)
    if not K[0, 0]:
        raise CalibrationError(
            f"{name}: camera_matrix is zero, which says that the camera is not calibrated"
        )
    R_rectified = shaped_numbers(data, "rectification_matrix", (3, 3), name=name)
    if not is_rotation(R_rectified):
        raise CalibrationError(
            f"{name}: rectification_matrix must be a rotation matrix (R^T R = I, det R = +1)"
        )
    P = shaped_numbers(data, "projection_matrix", (3, 4), name=name)
    if P[0, 0] <= 0:
        raise CalibrationError(
            f"{name}: projection_matrix must have a positive focal length at its upper left"
        )
    camera_name = data.get("camera_name", "")
    return _Camera(
        name=name,
        camera_name=camera_name if isinstance(camera_name, str) else "",
        size=size,
        K=K,
        D=distortion_numbers(data, "distortion_coefficients", name=name),
        model=_DISTORTION_MODELS[model],
        R_rectified=R_rectified,
        offset=float(P[0, 3] / P[0, 0]),
    )
