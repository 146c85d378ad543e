"""Strict reading of numbers from plain text data, as fields of models and by a mapping's key.

Refused values raise ``ValueError`` with a message in the form that ``FileModel`` describes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Annotated, TypeAlias, TypeVar

import numpy as np
from pydantic import PlainValidator

from observer.errors import InputError
from observer.geometry import Float64Array, Pose
from observer.text_files import NUMBER, FileModel, PlainData, sentence

# How OpenCV, YAML and C write non-finite numbers; matched to give the right reason for refusal.
_NOT_FINITE = re.compile(r"[-+]?\.?(nan|inf|infinity)", re.IGNORECASE)
# Far more than any key of a calibration needs.
_MAX_NUMBERS = 64

T = TypeVar("T")


def finite_numbers(value: PlainData) -> Float64Array:
    """Return the finite numbers of one key, float64.

    It accepts OpenCV's matrices (``rows``, ``cols``, ``data``: the result has that shape), plain
    lists, lists of equally long lists (2-D) and text of numbers separated by blanks (XML).

    Raises:
        ValueError: it is none of these; the text goes on from the key's name, as in "must be ...".
    """
    if not isinstance(value, dict):
        return _plain_array(value)
    missing = [part for part in ("rows", "cols", "data") if part not in value]
    if missing:
        raise ValueError(f"must be a matrix, but it has no {missing[0]}")
    rows, cols = (_side(value, part) for part in ("rows", "cols"))
    data = _plain_array(value["data"]).reshape(-1)
    # In a matrix of several channels (OpenCV saves vectors of points so) each one is a column.
    if (rows * cols == 0 and data.size) or (rows * cols and data.size % (rows * cols)):
        raise ValueError(f"must contain {rows} x {cols} numbers, but it holds {data.size}")
    if rows * cols and not data.size:
        raise ValueError(f"must contain {rows} x {cols} numbers, but it is empty")
    return data.reshape(rows, -1) if data.size else np.zeros((rows, cols))


def shaped(value: PlainData, *shape: int) -> Float64Array:
    """Return the finite numbers of one key, float64, in this shape.

    A flat list of the right length is read row by row.

    Raises:
        ValueError: as of ``finite_numbers``, or the shape is another one.
    """
    array = finite_numbers(value)
    wanted = " x ".join(map(str, shape))
    if len(shape) == 1 and array.size != shape[0]:
        raise ValueError(f"must contain {wanted} numbers, not {array.size}")
    if array.size != math.prod(shape) or (len(shape) == array.ndim != 1 and array.shape != shape):
        raise ValueError(f"must have shape {wanted}, not {_shape(array)}")
    return array.reshape(shape)


def _row_or_column(value: PlainData) -> Float64Array:
    """Return the (N,) finite numbers of a key that holds one row or one column."""
    array = finite_numbers(value)
    if array.ndim == 2 and array.size and 1 not in array.shape:
        raise ValueError(f"must be a single row or column, not {_shape(array)}")
    return array.reshape(-1)


def _transformation(value: PlainData) -> Pose:
    """Return the rigid transformation of a key that holds a 4 x 4 matrix."""
    matrix = shaped(value, 4, 4)
    try:
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError
        return Pose.from_matrix(matrix)
    except ValueError:
        raise ValueError(
            "must contain a rotation (R^T R = I, det R = +1), a translation and the row 0 0 0 1"
        ) from None


def image_size(value: PlainData) -> tuple[int, int]:
    """Return width and height in pixels from a key that holds these two.

    Raises:
        ValueError: as of ``shaped``, or they are no whole numbers up to a million.
    """
    size = shaped(value, 2)
    if (size != np.floor(size)).any() or (size < 0).any() or (size > 1e6).any():
        raise ValueError("must contain two whole numbers, [width, height] in pixels")
    return int(size[0]), int(size[1])


def _whole_number(value: PlainData) -> int:
    """Return one whole number from 0 to 1,000,000."""
    number = _number(value)
    if number != int(number) or not 0 <= number <= 1e6:
        raise ValueError(f"must be a whole number from 0 to 1000000, not {str(value)[:40]}")
    return int(number)


WholeNumber: TypeAlias = Annotated[int, PlainValidator(_whole_number)]
ImageSize: TypeAlias = Annotated[tuple[int, int], PlainValidator(image_size)]
RowOrColumn: TypeAlias = Annotated[Float64Array, PlainValidator(_row_or_column)]
Transformation: TypeAlias = Annotated[Pose, PlainValidator(_transformation)]


def array(*shape: int) -> PlainValidator:
    """Return the validator of a field that is an array of this shape."""
    return PlainValidator(lambda value: shaped(value, *shape))


class PinholeCamera(FileModel):
    """A camera whose file gives ``intrinsics`` (fx, fy, cx, cy) and ``resolution``."""

    intrinsics: Annotated[Float64Array, array(4)]
    resolution: ImageSize

    @property
    def K(self) -> Float64Array:
        fx, fy, cx, cy = self.intrinsics
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def at_key(
    data: Mapping[str, PlainData],
    key: str,
    read: Callable[[PlainData], T],
    name: str,
    label: str = "",
) -> T:
    """Return the value of a key as ``read`` parses it, for formats that no model describes.

    Args:
        label: what messages call the key if it is nested within other keys.

    Raises:
        InputError: the key is missing or refused; with key and reason.
    """
    label = label or key
    if key not in data:
        raise InputError(f"{name}: {label} is missing")
    try:
        return read(data[key])
    except ValueError as error:
        raise InputError(f"{name}: {sentence(label, str(error))}") from None


def _shape(array: Float64Array) -> str:
    return " x ".join(map(str, array.shape))


def _side(matrix: Mapping[str, PlainData], part: str) -> int:
    try:
        return _whole_number(matrix[part])
    except ValueError as error:
        raise ValueError(f"{{at}}.{part} {error}") from None


def _plain_array(value: PlainData) -> Float64Array:
    if isinstance(value, dict):
        raise ValueError("must contain numbers, not nested keys")
    items = value.split() if isinstance(value, str) else value
    if len(items) > _MAX_NUMBERS:
        raise ValueError(f"must contain at most {_MAX_NUMBERS} numbers, but it holds {len(items)}")
    if items and all(isinstance(item, list) for item in items):
        rows = [_plain_array(item) for item in items]
        if len({row.shape for row in rows}) != 1 or rows[0].ndim != 1:
            raise ValueError("the rows of {at} must have the same length")
        return np.stack(rows)
    return np.array([_number(item) for item in items], dtype=np.float64)


def _number(value: PlainData) -> float:
    if not isinstance(value, str):
        raise ValueError("must contain numbers, not several values")
    text = value.strip()
    if NUMBER.fullmatch(text):
        number = float(text)
        if math.isfinite(number):
            return number
    elif not _NOT_FINITE.fullmatch(text):
        raise ValueError(f"must contain numbers only, not {text[:40]!r}")
    raise ValueError(f"must contain finite numbers only, not {text[:40]}")
