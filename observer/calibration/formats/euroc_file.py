"""EuRoC's ``sensor.yaml``: one file for each camera, composed to a stereo calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from observer.calibration.formats.numbers import image_size, shaped_numbers, transformation
from observer.calibration.formats.plain_data import PlainData, parse_plain_data, read_text
from observer.calibration.formats.understanding import Draft, FileCamera, check_alike
from observer.camera import DistortionModel, StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Pose

_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "radial-tangential": "radtan",
    "radtan": "radtan",
    "equidistant": "equidistant",
}


def read_euroc(left: Path, right: Path) -> StereoCalibration:
    """The calibration of two cameras from their ``sensor.yaml`` files.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    return _draft(_read_file(left), _read_file(right)).calibration()


def euroc_draft(
    first: tuple[str, dict[str, PlainData]], second: tuple[str, dict[str, PlainData]]
) -> Draft:
    """The calibration of two ``sensor.yaml`` files; ``T_BS`` tells which of them is left.

    Args:
        first, second: name and top-level mapping of each file.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    a, b = _read_camera(*first), _read_camera(*second)
    # The second camera's place as the first one sees it.
    beside = (a.T_body_camera.inverse() @ b.T_body_camera).translation[0]
    left, right = (a, b) if beside >= 0 else (b, a)
    return _draft(left, right, f"T_BS tells that {left.name} is the left camera")


@dataclass(frozen=True, eq=False)
class _Camera(FileCamera):
    name: str
    T_body_camera: Pose


def _draft(left: _Camera, right: _Camera, *notes: str) -> Draft:
    check_alike(
        left,
        right,
        name=right.name,
        size="resolution",
        model="distortion_model",
        other="the left camera's",
    )
    # T_BS maps a camera's coordinates into the body's.
    T_right_left = right.T_body_camera.inverse() @ left.T_body_camera
    return Draft(
        source=right.name,
        format="EuRoC sensor.yaml of two cameras",
        size=left.size,
        K1=left.K,
        D1=left.D,
        K2=right.K,
        D2=right.D,
        R=T_right_left.rotation,
        T=T_right_left.translation,
        distortion_model=left.model,
        keys={
            "K1": "intrinsics of the left camera",
            "D1": "distortion_coefficients of the left camera",
            "K2": "intrinsics",
            "D2": "distortion_coefficients",
        },
        derived={"T": "T_BS of both cameras"},
        notes=(*notes, "rotation and baseline composed of T_BS of both cameras"),
    )


def _read_file(path: Path) -> _Camera:
    name = f"{path.parent.name}/{path.name}"
    return _read_camera(name, parse_plain_data(read_text(path), name=name))


def _read_camera(name: str, data: dict[str, PlainData]) -> _Camera:
    camera_model = data.get("camera_model", "pinhole")
    if camera_model != "pinhole":
        raise CalibrationError(
            f"{name}: camera_model must be pinhole, not {str(camera_model)[:40]!r}, "
            f"which is not understood yet"
        )
    distortion_model = data.get("distortion_model", "radial-tangential")
    if not isinstance(distortion_model, str) or distortion_model not in _DISTORTION_MODELS:
        raise CalibrationError(
            f"{name}: distortion_model must be radial-tangential or equidistant, "
            f"not {str(distortion_model)[:40]!r}, which is not understood yet"
        )
    size = image_size(data, "resolution", name=name)
    fx, fy, cx, cy = shaped_numbers(data, "intrinsics", (4,), name=name)
    return _Camera(
        name=name,
        size=size,
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        D=shaped_numbers(data, "distortion_coefficients", (4,), name=name),
        model=_DISTORTION_MODELS[distortion_model],
        T_body_camera=transformation(data, "T_BS", name=name),
    )
