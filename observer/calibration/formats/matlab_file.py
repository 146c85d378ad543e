"""MATLAB's ``stereoParameters`` in a MAT-file, as an object or as the struct that toStruct makes.

MATLAB multiplies row vectors from the left, so its older matrices are transposed; it counts pixels
from one; ImageSize is [height, width]; lengths are in the units of the board.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.calibration.formats.matlab_container import (
    MatlabObject,
    MatlabValue,
    read_matlab_variables,
)
from observer.calibration.formats.understanding import (
    Draft,
    DraftCamera,
    Size,
    Wanted,
    size_words,
)
from observer.calibration.formats.units import LengthUnit, Unit
from observer.errors import CalibrationError
from observer.extras import package_missing
from observer.geometry import Float64Array

_CLASS = "stereoParameters"
_INTRINSICS = ("IntrinsicMatrix", "K", "IntrinsicMatrixInternal")
_UNITS: Mapping[str, Unit] = {
    "mm": "mm", "millimeters": "mm", "millimetres": "mm",
    "cm": "cm", "centimeters": "cm", "centimetres": "cm",
    "m": "m", "meters": "m", "metres": "m",
    "in": "in", "inches": "in",
}  # fmt: skip
_AS_STRUCT = (
    "in MATLAB: stereoParams = toStruct(stereoParams); "
    "save('stereoParams.mat', 'stereoParams', '-v7')"
)
# Signature in files of version 7.3, after 512 bytes of MATLAB's own.
_HDF5 = b"\x89HDF\r\n\x1a\n"


def is_matlab(content: bytes) -> bool:
    """Return whether these bytes begin like a MAT-file."""
    return content.startswith((b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", _HDF5))


def matlab_draft(name: str, content: bytes, wanted: Wanted) -> Draft:
    """The calibration of a MAT-file that holds stereo parameters.

    If it holds an object and mat-io is not installed, the error says what to do.
    """
    if content[512:].startswith(_HDF5) or not content.startswith(b"MATLAB 5.0"):
        raise CalibrationError(
            f"{name}: this is a version 7.3 MAT-file (HDF5), which is not supported; {_AS_STRUCT}"
        )
    title, parameters = _stereo_parameters(name, content)
    notes = [f"variable {title}: MATLAB counts pixels from 1, so 1 was subtracted from cx and cy"]
    cameras = [_Camera(parameters, f"CameraParameters{number}", notes) for number in (1, 2)]
    size, size_is_given = _size(cameras, wanted, notes)
    R, T = _pose(parameters, notes)
    left, right = (
        DraftCamera(
            size,
            camera.K,
            camera.D,
            K_key=camera.intrinsics,
            D_key=f"{camera.struct.within}RadialDistortion",
        )
        for camera in cameras
    )
    return Draft(
        name,
        "MATLAB stereoParameters",
        left,
        right,
        R,
        T,
        unit=_unit(cameras[0].struct, wanted, notes),
        size_is_given=size_is_given,
        notes=tuple(notes),
    )


@dataclass(frozen=True, eq=False)
class _Struct:
    """Fields of a struct of the file ``name``, nested ``within`` others, as in ``A.``."""

    name: str
    fields: Mapping[str, MatlabValue]
    within: str = ""

    def numbers(self, key: str, count: int | None = None) -> Float64Array:
        """(N,) finite numbers of a field, in MATLAB's order: column by column."""
        begin = f"{self.name}: {self.within}{key}"
        value = self.fields.get(key)
        if value is None:
            raise CalibrationError(f"{begin} is missing; {_AS_STRUCT}")
        if not isinstance(value, np.ndarray):
            raise CalibrationError(f"{begin} must contain numbers")
        if count is not None and value.size != count:
            raise CalibrationError(f"{begin} must contain {count} numbers, not {value.size}")
        if not np.isfinite(value).all():
            raise CalibrationError(f"{begin} must contain finite numbers only")
        return value.reshape(-1, order="F")

    def matrix(self, key: str, size: int) -> Float64Array:
        """(size, size) finite numbers of a field."""
        return self.numbers(key, size * size).reshape(size, size, order="F")


def _stereo_parameters(name: str, content: bytes) -> tuple[str, _Struct]:
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
            f"{name}: the MAT-file holds {wrong} (it has {listed}); save exactly one, {_AS_STRUCT}"
        )
    title, value = found.popitem()
    if isinstance(value, dict):
        return title, _Struct(name, value)
    if importlib.util.find_spec("matio") is None:
        raise CalibrationError(
            f"{name}: {title} is a MATLAB object; "
            f"{package_missing('reading it', 'matlab', 'mat-io')} -- or save it as a struct, "
            f"{_AS_STRUCT}"
        )
    properties = value.properties
    if not isinstance(properties, dict) or "CameraParameters1" not in properties:
        raise CalibrationError(
            f"{name}: the object {title} is damaged or has no CameraParameters1; save it as a "
            f"struct, {_AS_STRUCT}"
        )
    return title, _Struct(name, properties)


class _Camera:
    """One of the two cameras' parameters."""

    def __init__(self, parameters: _Struct, key: str, notes: list[str]) -> None:
        name, fields = parameters.name, parameters.fields.get(key)
        if not isinstance(fields, dict):
            raise CalibrationError(f"{name}: {key} is missing or not a struct; {_AS_STRUCT}")
        inner = fields.get("Intrinsics")
        self.struct = _Struct(name, (inner if isinstance(inner, dict) else {}) | fields, f"{key}.")
        own = next((each for each in _INTRINSICS if each in self.struct.fields), _INTRINSICS[0])
        self.intrinsics = f"{key}.{own}"
        K = self.struct.matrix(own, 3)
        if (K[2, :2] != 0).any() and not K[:2, 2].any():
            K = K.T
            notes.append(f"{self.intrinsics} was transposed from MATLAB's convention")
        self.K = K.copy()
        self.K[:2, 2] -= 1
        radial = self.struct.numbers("RadialDistortion")
        if len(radial) not in (2, 3):
            raise CalibrationError(
                f"{name}: {key}.RadialDistortion must contain 2 or 3 numbers, not {len(radial)}"
            )
        tangential = self.struct.numbers("TangentialDistortion", 2)
        self.D = np.concatenate([radial[:2], tangential, radial[2:]])


def _size(cameras: list[_Camera], wanted: Wanted, notes: list[str]) -> tuple[Size, bool]:
    """Return width and height, and whether they are the wanted ones because the file has none."""
    sizes = []
    name = cameras[0].struct.name
    for struct in (camera.struct for camera in cameras):
        value = struct.fields.get("ImageSize")
        if not isinstance(value, np.ndarray) or value.size == 0:
            if wanted.size is None:
                raise CalibrationError(
                    f"{name}: {struct.within}ImageSize is missing or empty; specify the size of "
                    "the calibration images (image_width and image_height)"
                )
            notes.append(f"ImageSize is empty; {size_words(wanted.size)} is assumed")
            return wanted.size, True
        height, width = struct.numbers("ImageSize", 2)
        if height != int(height) or width != int(width) or not 0 <= max(height, width) <= 1e6:
            raise CalibrationError(
                f"{name}: {struct.within}ImageSize must contain two whole numbers, [height, width]"
            )
        sizes.append((int(width), int(height)))
    if sizes[0] != sizes[1]:
        raise CalibrationError(
            f"{name}: CameraParameters2.ImageSize is {size_words(sizes[1])}, but the left camera's "
            f"is {size_words(sizes[0])}; both cameras must have the same size"
        )
    return sizes[0], False


def _pose(parameters: _Struct, notes: list[str]) -> tuple[Float64Array, Float64Array]:
    """R_right_left and T. PoseCamera2, since R2022b, multiplies columns: it is not transposed."""
    fields = parameters.fields.get("PoseCamera2")
    if isinstance(fields, dict) and "RotationOfCamera2" not in parameters.fields:
        pose = _Struct(parameters.name, fields, "PoseCamera2.")
        if "A" in fields:
            matrix = pose.matrix("A", 4)
            return matrix[:3, :3].copy(), matrix[:3, 3].copy()
        return pose.matrix("R", 3), pose.numbers("Translation", 3)
    rotation = parameters.matrix("RotationOfCamera2", 3)
    notes.append("RotationOfCamera2 was transposed from MATLAB's convention")
    return rotation.T, parameters.numbers("TranslationOfCamera2", 3)


def _unit(camera: _Struct, wanted: Wanted, notes: list[str]) -> LengthUnit:
    if wanted.unit is not None:
        return wanted.unit
    words = camera.fields.get("WorldUnits")
    if not isinstance(words, str) or not words:
        notes.append("WorldUnits is not set; millimetres, MATLAB's default, are assumed")
        return "mm"
    if words.lower() not in _UNITS:
        raise CalibrationError(
            f"{camera.name}: {camera.within}WorldUnits is {words[:30]!r}, which is not a known "
            "unit of length; specify the unit, mm or m"
        )
    return _UNITS[words.lower()]
