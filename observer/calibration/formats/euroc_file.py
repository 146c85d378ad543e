"""EuRoC's ``sensor.yaml``: one file for each camera, composed to a stereo calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from observer.calibration.formats.numbers import number_array
from observer.calibration.formats.plain_data import PlainData, parse_plain_data, read_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array, Pose


def read_euroc(left: Path, right: Path) -> StereoCalibration:
    """The calibration of two cameras from their ``sensor.yaml`` files.

    ``T_BS`` maps a camera's coordinates into the body's, so that
    ``T_right_left = T_BS(right)^-1 T_BS(left)``.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    a, b = _read_camera(left), _read_camera(right)
    if a.size != b.size:
        raise CalibrationError(
            f"{_named(right)}: resolution is {b.size[0]}x{b.size[1]}, but the left camera's is "
            f"{a.size[0]}x{a.size[1]}; a pair must have one size"
        )
    T_right_left = b.T_body_camera.inverse() @ a.T_body_camera
    try:
        return StereoCalibration(
            *a.size, a.K, a.D, b.K, b.D, T_right_left.rotation, T_right_left.translation
        )
    except CalibrationError as error:
        raise CalibrationError(f"{_named(right)}: {error}") from None


@dataclass(frozen=True, eq=False)
class _Camera:
    size: tuple[int, int]
    K: Float64Array
    D: Float64Array
    T_body_camera: Pose


def _read_camera(path: Path) -> _Camera:
    name = _named(path)
    data = parse_plain_data(read_text(path), name=name)
    for key, supported in (
        ("camera_model", "pinhole"),
        ("distortion_model", "radial-tangential"),
    ):
        model = data.get(key, supported)
        if model not in (supported, "radtan"):
            raise CalibrationError(
                f"{name}: {key} must be {supported}, not {str(model)[:40]!r}, "
                f"which is not understood yet"
            )
    width, height = _numbers(data, "resolution", (2,), name)
    fx, fy, cx, cy = _numbers(data, "intrinsics", (4,), name)
    matrix = _numbers(data, "T_BS", (4, 4), name)
    try:
        T_body_camera = Pose.from_matrix(matrix)
    except ValueError:
        raise CalibrationError(f"{name}: T_BS must hold a rotation and a translation") from None
    return _Camera(
        size=(int(width), int(height)),
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        D=_numbers(data, "distortion_coefficients", (4,), name),
        T_body_camera=T_body_camera,
    )


def _numbers(
    data: dict[str, PlainData], key: str, shape: tuple[int, ...], name: str
) -> Float64Array:
    if key not in data:
        raise CalibrationError(f"{name}: {key} is missing")
    array = number_array(data[key], key=key, name=name)
    if array.size != int(np.prod(shape)):
        raise CalibrationError(
            f"{name}: {key} must hold {' x '.join(map(str, shape))} numbers, not {array.size}"
        )
    return array.reshape(shape)


def _named(path: Path) -> str:
    return f"{path.parent.name}/{path.name}"
