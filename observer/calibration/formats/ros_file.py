"""ROS ``camera_info`` files, as camera_calibration writes them: one for each camera.

Format: sensor_msgs/CameraInfo and camera_calibration_parsers. The transformation between the
cameras is not written down; it follows from both rectifications and the baseline in P.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from observer.calibration.formats.numbers import RowOrColumn, WholeNumber, array
from observer.calibration.formats.understanding import Draft, Size, check_alike
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array, is_rotation
from observer.text_files import FileModel, PlainData, one_of, validated

_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "plumb_bob": "radtan",
    "rational_polynomial": "radtan",
    # Drivers of cameras that rectify by themselves leave it out.
    "": "radtan",
    "none": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}


def _calibrated(K: Float64Array) -> Float64Array:
    if not K[0, 0]:
        raise ValueError("is zero, which says that the camera is not calibrated")
    return K


def _rotation(R: Float64Array) -> Float64Array:
    if not is_rotation(R):
        raise ValueError("must be a rotation matrix (R^T R = I, det R = +1)")
    return R


def _projection(P: Float64Array) -> Float64Array:
    if P[0, 0] <= 0:
        raise ValueError("must have a positive focal length at its upper left")
    return P


class _Camera(FileModel):
    name: str
    image_width: WholeNumber
    image_height: WholeNumber
    distortion_model: Annotated[
        DistortionModel,
        one_of(
            _DISTORTION_MODELS,
            "must be plumb_bob, rational_polynomial or equidistant, not {given}",
        ),
    ] = "radtan"
    camera_matrix: Annotated[Float64Array, array(3, 3), AfterValidator(_calibrated)]
    rectification_matrix: Annotated[Float64Array, array(3, 3), AfterValidator(_rotation)]
    projection_matrix: Annotated[Float64Array, array(3, 4), AfterValidator(_projection)]
    distortion_coefficients: RowOrColumn
    camera_name: Any = ""

    @property
    def size(self) -> Size:
        return self.image_width, self.image_height

    @property
    def model(self) -> DistortionModel:
        return self.distortion_model

    @property
    def offset(self) -> float:
        return float(self.projection_matrix[0, 3] / self.projection_matrix[0, 0])

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
    a, b = (validated(_Camera, data | {"name": name}, name) for name, data in (first, second))
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
        K1=left.camera_matrix,
        D1=left.distortion_coefficients,
        K2=right.camera_matrix,
        D2=right.distortion_coefficients,
        R=right.rectification_matrix.T @ left.rectification_matrix,
        T=right.rectification_matrix.T @ np.array([-baseline, 0.0, 0.0]),
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
