"""MATLAB's ``stereoParameters`` in a MAT-file, as an object or as the struct that toStruct makes.

MATLAB multiplies rows from the left, so that its older matrices stand transposed; it counts pixels
from one; ImageSize is [height, width]; lengths are in the units of the board.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from observer.calibration.formats.matlab_container import (
    MatlabObject,
    MatlabValue,
    is_mat_io_installed,
    read_matlab_variables,
)
from observer.calibration.formats.understanding import Draft, Size, Unit, Wanted, size_words
from observer.errors import CalibrationError
from observer.geometry import Float64Array

_Fields: TypeAlias = Mapping[str, MatlabValue]

_CLASS = "stereoParameters"
_INTRINSICS = ("IntrinsicMatrix", "K", "IntrinsicMatrixInternal")
_UNITS: Mapping[str, Unit] = MappingProxyType(
    {
        "mm": "mm", "millimeters": "mm", "millimetres": "mm",
        "cm": "cm", "centimeters": "cm", "centimetres": "cm",
        "m": "m", "meters": "m", "metres": "m",
        "in": "in", "inches": "in",
    }
)  # fmt: skip
_AS_STRUCT = (
    "in MATLAB: stereoParams = toStruct(stereoParams); "
    "save('stereoParams.mat', 'stereoParams', '-v7')"
)
# What files of version 7.3 hold, behind 512 bytes of MATLAB's own.
_HDF5 = b"\x89HDF\r\n\x1a\n"


def is_matlab(content: bytes) -> bool:
    """Return whether these bytes begin as a MAT-file does."""
    return content.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", _HDF5))


def matlab_draft(name: str, content: bytes, wanted: Wanted) -> Draft:
    """The calibration of a MAT-file that holds stereo parameters.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason; where the file
            holds an object and mat-io is not installed, how to go on.
    """
    if content[512:].startswith(_HDF5) or not content.startswith(b"MATLAB 5.0"):
        raise CalibrationError(
            f"{name}: this is a MAT-file of version 7.3 (HDF5), which is not read; {_AS_STRUCT}"
        )
    title, parameters = _stereo_parameters(name, content)
    notes = [f"variable {title}: MATLAB's pixels count from 1, so 1 was subtracted from cx and cy"]
    left, right = (
        _Camera(name, parameters, f"CameraParameters{number}", notes) for number in (1, 2)
    )
    size, size_was_told = _size(name, left, right, wanted, notes)
    R, T = _pose(name, parameters, notes)
    return Draft(
        source=name,
        format="MATLAB stereoParameters",
        size=size,
        K1=left.K,
        D1=left.D,
        K2=right.K,
        D2=right.D,
        R=R,
        T=T,
        unit=_unit(name, left.fields, wanted, notes),
        size_was_told=size_was_told,
        keys={
            "K1": left.intrinsics,
            "D1": "CameraParameters1.RadialDistortion",
            "K2": right.intrinsics,
            "D2": "CameraParameters2.RadialDistortion",
        },
        notes=tuple(notes),
    )


def _stereo_parameters(name: str, content: bytes) -> tuple[str, _Fields]:
    variables = read_matlab_variables(content, name=name)
    found = {
        title: value
        for title, value in variables.items()
        if (isinstance(value, dict) and "CameraParameters1" in value)
        or (isinstance(value, MatlabObject) and value.class_name == _CLASS)
    }
    if len(found) != 1:
        listed = ", ".join(sorted(filter(None, found or variables))[:5])[:100] or "nothing"
        wrong = "more than one stereoParameters" if found else "no stereoParameters"
        raise CalibrationError(
            f"{name}: the MAT-file holds {wrong} (it has {listed}); save one alone, {_AS_STRUCT}"
        )
    title, value = found.popitem()
    if isinstance(value, dict):
        return title, value
    if not is_mat_io_installed():
        raise CalibrationError(
            f"{name}: {title} is a MATLAB object, which needs the package mat-io to be read; "
            f"install it by: pip install 'dynamic-observer[matlab]' -- or save it as a struct, "
            f"{_AS_STRUCT}"
        )
    properties = value.properties
    if not isinstance(properties, dict) or "CameraParameters1" not in properties:
        raise CalibrationError(
            f"{name}: the object {title} is damaged or has no CameraParameters1; save it as a "
            f"struct, {_AS_STRUCT}"
        )
    return title, properties


class _Camera:
    """One of the two cameras' parameters."""

    def __init__(self, name: str, parameters: _Fields, key: str, notes: list[str]) -> None:
        fields = parameters.get(key)
        if not isinstance(fields, dict):
            raise CalibrationError(f"{name}: {key} is missing or no struct; {_AS_STRUCT}")
        inner = fields.get("Intrinsics")
        self.fields: _Fields = {**inner, **fields} if isinstance(inner, dict) else fields
        self.key = key
        own = next((each for each in _INTRINSICS if each in self.fields), _INTRINSICS[0])
        self.intrinsics = f"{key}.{own}"
        K = _numbers(name, self.fields, own, (9,), key).reshape(3, 3, order="F")
        if (K[2, :2] != 0).any() and not K[:2, 2].any():
            K = K.T
            notes.append(f"{self.intrinsics} was transposed, as MATLAB keeps it")
        self.K = K.copy()
        self.K[:2, 2] -= 1
        radial = _numbers(name, self.fields, "RadialDistortion", None, key)
        if len(radial) not in (2, 3):
            raise CalibrationError(
                f"{name}: {key}.RadialDistortion must hold 2 or 3 numbers, not {len(radial)}"
            )
        tangential = _numbers(name, self.fields, "TangentialDistortion", (2,), key)
        self.D = np.concatenate([radial[:2], tangential, radial[2:]])


def _size(
    name: str, left: _Camera, right: _Camera, wanted: Wanted, notes: list[str]
) -> tuple[Size, bool]:
    sizes = []
    for camera in (left, right):
        value = camera.fields.get("ImageSize")
        if not isinstance(value, np.ndarray) or value.size == 0:
            if wanted.size is None:
                raise CalibrationError(
                    f"{name}: {camera.key}.ImageSize is missing or empty; give the size of the "
                    f"images that were calibrated with (image_width and image_height)"
                )
            notes.append(f"ImageSize is empty, taken as {size_words(wanted.size)}")
            return wanted.size, True
        height, width = _numbers(name, camera.fields, "ImageSize", (2,), camera.key)
        if height != int(height) or width != int(width) or not 0 <= max(height, width) <= 1e6:
            raise CalibrationError(
                f"{name}: {camera.key}.ImageSize must hold two whole numbers, [height, width]"
            )
        sizes.append((int(width), int(height)))
    if sizes[0] != sizes[1]:
        raise CalibrationError(
            f"{name}: CameraParameters2.ImageSize is {size_words(sizes[1])}, but the left "
            f"camera's is {size_words(sizes[0])}; a pair must have one size"
        )
    return sizes[0], False


def _pose(name: str, parameters: _Fields, notes: list[str]) -> tuple[Float64Array, Float64Array]:
    """R_right_left and T. PoseCamera2, since R2022b, multiplies columns and is not transposed."""
    pose = parameters.get("PoseCamera2")
    if isinstance(pose, dict) and "RotationOfCamera2" not in parameters:
        if "A" in pose:
            matrix = _numbers(name, pose, "A", (16,), "PoseCamera2").reshape(4, 4, order="F")
            return matrix[:3, :3].copy(), matrix[:3, 3].copy()
        rotation = _numbers(name, pose, "R", (9,), "PoseCamera2").reshape(3, 3, order="F")
        return rotation, _numbers(name, pose, "Translation", (3,), "PoseCamera2")
    rotation = _numbers(name, parameters, "RotationOfCamera2", (9,)).reshape(3, 3, order="F")
    notes.append("RotationOfCamera2 was transposed, as MATLAB keeps it")
    return rotation.T, _numbers(name, parameters, "TranslationOfCamera2", (3,))


def _unit(name: str, camera: _Fields, wanted: Wanted, notes: list[str]) -> Unit:
    if wanted.unit is not None:
        return wanted.unit
    words = camera.get("WorldUnits")
    if not isinstance(words, str) or not words:
        notes.append("WorldUnits is not given, taken as millimetres, MATLAB's default")
        return "mm"
    if words.lower() not in _UNITS:
        raise CalibrationError(
            f"{name}: CameraParameters1.WorldUnits is {words[:30]!r}, which is no known unit of "
            f"length; say the unit, mm or m"
        )
    return _UNITS[words.lower()]


def _numbers(
    name: str, fields: _Fields, key: str, shape: tuple[int] | None, within: str = ""
) -> Float64Array:
    """(N,) finite numbers of a field, in MATLAB's order: column by column."""
    label = f"{within}.{key}" if within else key
    value = fields.get(key)
    if value is None:
        raise CalibrationError(f"{name}: {label} is missing; {_AS_STRUCT}")
    if not isinstance(value, np.ndarray):
        raise CalibrationError(f"{name}: {label} must hold numbers")
    if shape is not None and value.size != shape[0]:
        raise CalibrationError(f"{name}: {label} must hold {shape[0]} numbers, not {value.size}")
    if not np.isfinite(value).all():
        raise CalibrationError(f"{name}: {label} must hold finite numbers only")
    return value.reshape(-1, order="F")
