"""Calibrations as OpenCV's FileStorage writes them: YAML, XML or JSON; metres and pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from observer.calibration.formats.numbers import number_array, whole_number
from observer.calibration.formats.plain_data import PlainData, parse_plain_data, read_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# The names people and programs give to one and the same thing; the first is ours.
_KEYS = {
    "K1": ("K1", "M1", "cameraMatrix1", "camera_matrix_1", "CM1"),
    "D1": ("D1", "distCoeffs1", "dist_coeffs_1"),
    "K2": ("K2", "M2", "cameraMatrix2", "camera_matrix_2", "CM2"),
    "D2": ("D2", "distCoeffs2", "dist_coeffs_2"),
    "R": ("R",),
    "T": ("T",),
}
_SIZE_KEYS = ("image_size", "imageSize", "size")


def read_calibration_file(path: Path | str) -> StereoCalibration:
    """Read a calibration from a file.

    Raises:
        CalibrationError: the file cannot be read, or what ``read_calibration`` refuses.
    """
    path = Path(path)
    return read_calibration(read_text(path), name=path.name)


def read_calibration(text: str, *, name: str) -> StereoCalibration:
    """Read a calibration from the text of a FileStorage file.

    Keys: ``K1 D1 K2 D2 R T`` (``M1 M2`` and ``cameraMatrix1 distCoeffs1`` ... are understood)
    and ``image_width image_height`` or ``image_size`` as [width, height]. T in metres.

    Args:
        text: the whole file.
        name: what it is called in messages, mostly the file's name.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    data = parse_plain_data(text, name=name)
    # In an XML of FileStorage the root is <opencv_storage>, and its children are the keys.
    missing = [key for key, names in _KEYS.items() if not any(n in data for n in names)]
    if missing:
        raise CalibrationError(f"{name}: {_missing_sentence(missing)}")
    width, height = _image_size(data, name)
    a = {key: _array(data, key, name) for key in _KEYS}
    try:
        return StereoCalibration(width, height, a["K1"], a["D1"], a["K2"], a["D2"], a["R"], a["T"])
    except CalibrationError as error:
        raise CalibrationError(f"{name}: {error}") from None


def calibration_text(calibration: StereoCalibration) -> str:
    """The calibration as OpenCV FileStorage YAML; reading it back gives every digit again."""
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {calibration.width}",
        f"image_height: {calibration.height}",
    ]
    for key in _KEYS:
        values: Float64Array = getattr(calibration, key)
        matrix = values if values.ndim == 2 else values.reshape(-1, 1)
        if key in ("D1", "D2"):
            matrix = matrix.reshape(1, -1)
        numbers = ", ".join(repr(float(value)) for value in matrix.ravel())
        lines += [
            f"{key}: !!opencv-matrix",
            f"   rows: {matrix.shape[0]}",
            f"   cols: {matrix.shape[1]}",
            "   dt: d",
            f"   data: [ {numbers} ]",
        ]
    return "\n".join(lines) + "\n"


def _missing_sentence(missing: list[str]) -> str:
    names = " and ".join([", ".join(missing[:-1]), missing[-1]] if missing[1:] else missing)
    verb = "are" if missing[1:] else "is"
    if set(missing) <= {"R", "T"}:
        hint = "OpenCV's stereo_calib keeps R and T in extrinsics.yml, put all into one file"
    elif not set(missing) & {"R", "T"}:
        hint = "OpenCV's stereo_calib keeps M1 D1 M2 D2 in intrinsics.yml, put all into one file"
    else:
        hint = "a stereo calibration has K1 D1 K2 D2 R T image_width image_height"
    return f"{names} {verb} missing; {hint}"


def _array(data: dict[str, PlainData], key: str, name: str) -> Float64Array:
    found = next(n for n in _KEYS[key] if n in data)
    array = number_array(data[found], key=found, name=name)
    shape = " x ".join(map(str, array.shape))
    if key in ("K1", "K2", "R"):
        if array.size != 9 or (array.ndim == 2 and array.shape != (3, 3)):
            raise CalibrationError(f"{name}: {found} must have shape 3 x 3, not {shape}")
        return array.reshape(3, 3)
    if array.ndim == 2 and array.size and 1 not in array.shape:
        raise CalibrationError(f"{name}: {found} must be one row or one column, not {shape}")
    if key == "T" and array.size != 3:
        raise CalibrationError(f"{name}: T must hold 3 numbers, not {array.size}")
    return np.asarray(array.reshape(-1), dtype=np.float64)


def _image_size(data: dict[str, PlainData], name: str) -> tuple[int, int]:
    if "image_width" in data and "image_height" in data:
        return (
            whole_number(data["image_width"], key="image_width", name=name),
            whole_number(data["image_height"], key="image_height", name=name),
        )
    for key in _SIZE_KEYS:
        if key not in data:
            continue
        size = number_array(data[key], key=key, name=name).reshape(-1)
        if size.size != 2 or (size != size.astype(np.int64)).any():
            raise CalibrationError(
                f"{name}: {key} must hold two whole numbers, [width, height] in pixels"
            )
        return int(size[0]), int(size[1])
    absent = next((k for k in ("image_width", "image_height") if k not in data), "")
    raise CalibrationError(
        f"{name}: {absent} is missing; add image_width and image_height, the size in pixels of "
        f"the images that were calibrated with"
    )
