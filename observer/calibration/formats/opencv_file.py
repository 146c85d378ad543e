"""Calibrations as OpenCV's FileStorage writes them: YAML, XML or JSON; metres and pixels."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import PlainValidator

from observer.calibration.formats.numbers import (
    ImageSize,
    RowOrColumn,
    WholeNumber,
    array,
    finite_numbers,
    shaped,
)
from observer.calibration.formats.plain_data import (
    CALIBRATION,
    NamedData,
    calibration_errors,
    parse_plain_data,
)
from observer.calibration.formats.understanding import Draft, DraftCamera, Size, Wanted, size_words
from observer.camera import DistortionModel, StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array, rotation_matrix
from observer.text_files import FileModel, PlainData, dotted, one_of, read_text, validated

# The names that people and programs use for the same thing; the first is ours.
_KEYS: Mapping[str, tuple[str, ...]] = {
    "K1": (
        "K1", "M1", "cameraMatrix1", "camera_matrix_1", "CM1", "K_LEFT", "K_left",
        "camera_matrix_left", "left_camera_matrix", "cameraMatrixL", "mtxL", "Kl", "KL",
    ),
    "D1": (
        "D1", "distCoeffs1", "dist_coeffs_1", "distortion_1", "D_LEFT", "D_left",
        "D_LEFT_FE", "dist_coeffs_left", "left_distortion_coefficients", "distCoeffsL",
        "distL", "Dl", "DL",
    ),
    "K2": (
        "K2", "M2", "cameraMatrix2", "camera_matrix_2", "CM2", "K_RIGHT", "K_right",
        "camera_matrix_right", "right_camera_matrix", "cameraMatrixR", "mtxR", "Kr", "KR",
    ),
    "D2": (
        "D2", "distCoeffs2", "dist_coeffs_2", "distortion_2", "D_RIGHT", "D_right",
        "D_RIGHT_FE", "dist_coeffs_right", "right_distortion_coefficients", "distCoeffsR",
        "distR", "Dr", "DR",
    ),
    "R": ("R", "rotation_matrix", "rotationMatrix", "rotation", "Rot"),
    "T": ("T", "translation_vector", "translationVector", "translation", "Trans"),
}  # fmt: skip
_SIZE_KEYS = ("image_size", "imageSize", "size", "Size")
# Stereolabs' calibration tool marks fisheye coefficients by their key.
_FISHEYE_KEYS = ("D_LEFT_FE", "D_RIGHT_FE")
_MODEL_KEY = "distortion_model"
_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "radtan": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
}


def _rotation(value: PlainData) -> Float64Array:
    return shaped(value, 3) if finite_numbers(value).size == 3 else shaped(value, 3, 3)


class _Stereo(FileModel):
    """A calibration under our own key names; ``R`` may be a rotation vector."""

    distortion_model: Annotated[
        DistortionModel, one_of(_DISTORTION_MODELS, "must be radtan or equidistant, not {given}")
    ] = "radtan"
    image_width: WholeNumber | None = None
    image_height: WholeNumber | None = None
    image_size: ImageSize | None = None
    R: Annotated[Float64Array, PlainValidator(_rotation)]
    K1: Annotated[Float64Array, array(3, 3)]
    D1: RowOrColumn
    K2: Annotated[Float64Array, array(3, 3)]
    D2: RowOrColumn
    T: Annotated[Float64Array, array(3)]

    @property
    def size(self) -> Size | None:
        if self.image_width is None or self.image_height is None:
            return self.image_size
        return self.image_width, self.image_height


@calibration_errors()
def read_noted_calibration(path: Path | str) -> tuple[StereoCalibration, tuple[str, ...]]:
    """Read a calibration from a file; also return a sentence on each lens that was replaced."""
    path = Path(path)
    text = read_text(path, CALIBRATION)
    draft = opencv_draft([(path.name, parse_plain_data(text, name=path.name))], Wanted())
    return draft.calibration(), tuple(f"{path.name}: {note}" for note in draft.smooth_notes())


@calibration_errors()
def read_calibration(text: str, *, name: str) -> StereoCalibration:
    """Read a calibration from the text of a FileStorage file.

    Keys: ``K1 D1 K2 D2 R T`` (``M1 M2`` and ``cameraMatrix1 distCoeffs1`` ... are understood)
    and ``image_width image_height`` or ``image_size`` as [width, height]. T in metres.
    ``distortion_model: equidistant`` where the lenses are fisheye lenses.

    Args:
        name: what the text is called in messages, usually the file's name.
    """
    # In FileStorage XML the root is <opencv_storage>, and its children are the keys.
    return opencv_draft([(name, parse_plain_data(text, name=name))], Wanted()).calibration()


def opencv_draft(files: Sequence[NamedData], wanted: Wanted) -> Draft:
    """The calibration of one file, or of several that together hold all keys.

    OpenCV's sample stereo_calib, for example, writes ``intrinsics.yml`` and ``extrinsics.yml``.

    Args:
        wanted: ``size`` is used if no file states the size of the images.
    """
    name, data = _merged(files)
    found = {key: next((n for n in names if n in data), "") for key, names in _KEYS.items()}
    missing = [key for key, own in found.items() if not own]
    if missing:
        raise CalibrationError(f"{name}: {_missing_sentence(missing)}")
    own_keys = found | _size_keys(data, name, required=wanted.size is None)
    fisheye = any(key in data for key in _FISHEYE_KEYS)
    if _MODEL_KEY in data and not fisheye:
        own_keys[_MODEL_KEY] = _MODEL_KEY
    read = validated(
        _Stereo,
        {key: data[own] for key, own in own_keys.items()},
        name,
        lambda location: dotted(tuple(own_keys[str(key)] for key in location)),
    )
    size = read.size
    notes = []
    if fisheye:
        notes.append("D_LEFT_FE and D_RIGHT_FE: fisheye lenses")
    elif read.distortion_model == "equidistant":
        notes.append("fisheye lenses (equidistant)")
    if size is None and wanted.size is not None:
        notes.append(
            f"the file does not contain the image size; {size_words(wanted.size)} is assumed"
        )
    if read.R.ndim == 1:
        notes.append(f"{found['R']} has three numbers and is read as a rotation vector")
    used = size or wanted.size or (0, 0)
    model: DistortionModel = "equidistant" if fisheye else read.distortion_model
    return Draft(
        name,
        "OpenCV FileStorage" + (" in two files" if len(files) > 1 else ""),
        DraftCamera(used, read.K1, read.D1, model, found["K1"], found["D1"]),
        DraftCamera(used, read.K2, read.D2, model, found["K2"], found["D2"]),
        rotation_matrix(read.R) if read.R.ndim == 1 else read.R,
        read.T,
        size_is_given=size is None,
        R_key=found["R"],
        T_key=found["T"],
        notes=tuple(notes),
    )


def is_opencv(data: Mapping[str, PlainData]) -> bool:
    """Return whether a mapping holds keys of a stereo calibration as OpenCV's users write them."""
    return any(name in data for names in _KEYS.values() for name in names)


def calibration_id(text: str) -> str:
    """A calibration's id: SHA-256 of its file's UTF-8 text, 64 hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def calibration_text(calibration: StereoCalibration) -> str:
    """The calibration as OpenCV FileStorage YAML; reading it back restores every digit."""
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {calibration.width}",
        f"image_height: {calibration.height}",
    ]
    if calibration.distortion_model != "radtan":
        lines.append(f"{_MODEL_KEY}: {calibration.distortion_model}")
    for key in _KEYS:
        values: Float64Array = getattr(calibration, key)
        matrix = values[None] if key in ("D1", "D2") else values.reshape(3, -1)
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
    joined = "supply both files, or merge them into one"
    if set(missing) <= {"R", "T"}:
        hint = f"OpenCV's stereo_calib writes R and T to extrinsics.yml, {joined}"
    elif not set(missing) & {"R", "T"}:
        hint = f"OpenCV's stereo_calib writes M1 D1 M2 D2 to intrinsics.yml, {joined}"
    else:
        hint = "a stereo calibration contains K1 D1 K2 D2 R T image_width image_height"
    return f"{names} {verb} missing; {hint}"


def _merged(files: Sequence[NamedData]) -> NamedData:
    """Return a name for all files together, for messages, and all their keys."""
    merged: dict[str, PlainData] = {}
    whose: dict[str, str] = {}
    read = {*(own for names in _KEYS.values() for own in names), *_SIZE_KEYS, _MODEL_KEY}
    read |= {"image_width", "image_height"}
    for name, data in files:
        for key, value in data.items():
            if key in read and key in merged and merged[key] != value:
                raise CalibrationError(
                    f"{name}: {key} differs from {key} in {whose[key]}; supply files from the same "
                    "calibration"
                )
            merged[key] = value
            whose.setdefault(key, name)
    return " and ".join(name for name, _ in files), merged


def _size_keys(data: Mapping[str, PlainData], name: str, *, required: bool) -> dict[str, str]:
    """Return the keys that state the images' size: our name of each, and the file's."""
    absent = [key for key in ("image_width", "image_height") if key not in data]
    if not absent:
        return {"image_width": "image_width", "image_height": "image_height"}
    found = next((key for key in _SIZE_KEYS if key in data), None)
    if found is None and required:
        raise CalibrationError(
            f"{name}: {absent[0]} is missing; add image_width and image_height, the size of the "
            "calibration images in pixels"
        )
    return {} if found is None else {"image_size": found}
