"""ROS ``camera_info``, as camera_calibration or ``rostopic echo`` writes it: one file a camera.

Format: sensor_msgs/CameraInfo and camera_calibration_parsers. The transformation between the
cameras is not written down; it follows from both rectifications and the baseline in P.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from observer.calibration.formats.numbers import RowOrColumn, WholeNumber, array
from observer.calibration.formats.plain_data import NamedData
from observer.calibration.formats.understanding import Draft, DraftCamera, check_alike
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array, is_rotation
from observer.text_files import FileModel, PlainData, one_of, validated

# Lens models, except for fisheye, that camera_calibration writes and image_proc knows, by their
# number of coefficients.
ROS_MODELS = {5: "plumb_bob", 8: "rational_polynomial"}
_DISTORTION_MODELS: dict[str, DistortionModel] = {
    "plumb_bob": "radtan",
    "rational_polynomial": "radtan",
    # Drivers of cameras that rectify internally leave it empty.
    "": "radtan",
    "none": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}


def _calibrated(K: Float64Array) -> Float64Array:
    if not K[0, 0]:
        raise ValueError("is zero, which means that the camera is not calibrated")
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
            _DISTORTION_MODELS, "must be plumb_bob, rational_polynomial or equidistant, not {given}"
        ),
    ] = "radtan"
    camera_matrix: Annotated[Float64Array, array(3, 3), AfterValidator(_calibrated)]
    rectification_matrix: Annotated[Float64Array, array(3, 3), AfterValidator(_rotation)]
    projection_matrix: Annotated[Float64Array, array(3, 4), AfterValidator(_projection)]
    distortion_coefficients: RowOrColumn
    camera_name: Any = ""

    def drafted(self, whose: str) -> DraftCamera:
        return DraftCamera(
            (self.image_width, self.image_height),
            self.camera_matrix,
            self.distortion_coefficients,
            self.distortion_model,
            f"camera_matrix{whose}",
            f"distortion_coefficients{whose}",
        )

    @property
    def offset(self) -> float:
        return float(self.projection_matrix[0, 3] / self.projection_matrix[0, 0])

    def is_called(self, side: str) -> bool:
        return side in f"{self.name} {self.camera_name}".lower()


# Keys of a file by the fields of a message, which ROS 2 writes in lower case.
_OF_MESSAGE = {
    "width": "image_width",
    "height": "image_height",
    "k": "camera_matrix",
    "d": "distortion_coefficients",
    "r": "rectification_matrix",
    "p": "projection_matrix",
}


def named_as_in_files(data: dict[str, PlainData]) -> dict[str, PlainData]:
    """Return a printed ``sensor_msgs/CameraInfo`` with the keys of a file; other data as it is."""
    lower = {key.lower(): value for key, value in data.items()}
    if len(lower) < len(data) or not lower.keys() >= {"distortion_model", *_OF_MESSAGE}:
        return data
    return {_OF_MESSAGE.get(key, key): value for key, value in lower.items()}


def ros_draft(first: NamedData, second: NamedData) -> Draft:
    """The calibration of two ``camera_info`` files; the baseline in P tells which one is right."""
    a, b = (validated(_Camera, data | {"name": name}, name) for name, data in (first, second))
    left, right = (a, b) if b.offset <= a.offset else (b, a)
    if left.offset == right.offset:
        raise CalibrationError(
            f"{right.name}: projection_matrix has the same offset P[3] in both files, so the "
            "baseline would be zero; calibrate the two cameras together as a stereo pair"
        )
    cameras = left.drafted(" of the left camera"), right.drafted("")
    check_alike(*cameras, right.name, size="image_width x image_height")
    notes = [
        f"{left.name} is the left camera (projection_matrix)",
        "rotation and baseline derived from rectification_matrix and projection_matrix",
    ]
    if left.is_called("right") or right.is_called("left"):
        notes[0] += ", although the file names suggest otherwise"
        notes.append(
            "P[3], -fx times the baseline of the right camera, is "
            f"{right.projection_matrix[0, 3]:.5g} in {right.name} and "
            f"{left.projection_matrix[0, 3]:.5g} in {left.name}: the cameras are swapped: use the "
            f"images of {left.name} as the left ones"
        )
    # In the rectified frames the right camera is at x = baseline:
    # R_right X_right = R_left X_left - (baseline, 0, 0).
    baseline = left.offset - right.offset
    return Draft(
        right.name,
        "ROS camera_info of two cameras",
        *cameras,
        right.rectification_matrix.T @ left.rectification_matrix,
        right.rectification_matrix.T @ np.array([-baseline, 0.0, 0.0]),
        derived={
            "R": "rectification_matrix of both cameras",
            "T": "rectification_matrix and projection_matrix of both cameras",
        },
        notes=tuple(notes),
    )
