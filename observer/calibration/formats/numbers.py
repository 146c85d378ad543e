"""Numbers out of plain text data: strictly, and with the key's name in every refusal."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from observer.calibration.formats.plain_data import PlainData
from observer.errors import CalibrationError
from observer.geometry import Float64Array, Pose

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
# How OpenCV, YAML and C write what is not finite; refused, but for the right reason.
_NOT_FINITE = re.compile(r"[-+]?\.?(nan|inf|infinity)", re.IGNORECASE)
# Far more than any key of a calibration needs.
_MAX_NUMBERS = 64


def number_array(value: PlainData, *, key: str, name: str) -> Float64Array:
    """The finite numbers of one key, float64.

    Accepted are OpenCV's matrices (``rows``, ``cols``, ``data``: the result has that shape),
    plain lists, lists of equally long lists (2-D) and text of numbers between blanks (XML).

    Raises:
        CalibrationError: naming the key and the reason.
    """
    if not isinstance(value, dict):
        return _plain_array(value, key, name)
    missing = [part for part in ("rows", "cols", "data") if part not in value]
    if missing:
        raise CalibrationError(f"{name}: {key} must be a matrix, but it has no {missing[0]}")
    rows = whole_number(value["rows"], key=f"{key}.rows", name=name)
    cols = whole_number(value["cols"], key=f"{key}.cols", name=name)
    data = _plain_array(value["data"], key, name).reshape(-1)
    # A matrix of several channels (OpenCV saves vectors of points so) counts each as a column.
    if (rows * cols == 0 and data.size) or (rows * cols and data.size % (rows * cols)):
        raise CalibrationError(
            f"{name}: {key} must hold {rows} x {cols} numbers, but it holds {data.size}"
        )
    if rows * cols and not data.size:
        raise CalibrationError(f"{name}: {key} must hold {rows} x {cols} numbers, but it is empty")
    return data.reshape(rows, -1) if data.size else np.zeros((rows, cols))


def shaped_numbers(
    data: Mapping[str, PlainData],
    key: str,
    shape: tuple[int, ...],
    *,
    name: str,
    label: str | None = None,
) -> Float64Array:
    """The finite numbers of one key of a mapping, float64, in this shape.

    A list of as many numbers is taken row by row; a matrix of another shape is refused.

    Args:
        label: what the key is called in messages where it stands within other keys.

    Raises:
        CalibrationError: the key is missing, or its numbers are not as many; with key and reason.
    """
    label = label or key
    if key not in data:
        raise CalibrationError(f"{name}: {label} is missing")
    array = number_array(data[key], key=label, name=name)
    wanted = " x ".join(map(str, shape))
    if len(shape) == 1 and array.size != shape[0]:
        raise CalibrationError(f"{name}: {label} must hold {wanted} numbers, not {array.size}")
    if array.size != int(np.prod(shape)) or (
        len(shape) == array.ndim != 1 and array.shape != shape
    ):
        found = " x ".join(map(str, array.shape))
        raise CalibrationError(f"{name}: {label} must have shape {wanted}, not {found}")
    return array.reshape(shape)


def distortion_numbers(
    data: Mapping[str, PlainData], key: str, *, name: str, label: str | None = None
) -> Float64Array:
    """(N,) distortion coefficients of one key of a mapping, given as one row or one column.

    Raises:
        CalibrationError: naming the key and the reason.
    """
    label = label or key
    if key not in data:
        raise CalibrationError(f"{name}: {label} is missing")
    array = number_array(data[key], key=label, name=name)
    if array.ndim == 2 and array.size and 1 not in array.shape:
        shape = " x ".join(map(str, array.shape))
        raise CalibrationError(f"{name}: {label} must be one row or one column, not {shape}")
    return array.reshape(-1)


def transformation(
    data: Mapping[str, PlainData], key: str, *, name: str, label: str | None = None
) -> Pose:
    """The rigid motion of a key that holds a 4 x 4 matrix.

    Raises:
        CalibrationError: naming the key and the reason.
    """
    matrix = shaped_numbers(data, key, (4, 4), name=name, label=label)
    try:
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError
        return Pose.from_matrix(matrix)
    except ValueError:
        raise CalibrationError(
            f"{name}: {label or key} must hold a rotation (R^T R = I, det R = +1), a translation "
            f"and the row 0 0 0 1"
        ) from None


def image_size(
    data: Mapping[str, PlainData], key: str, *, name: str, label: str | None = None
) -> tuple[int, int]:
    """Width and height in pixels of a key that holds these two.

    Raises:
        CalibrationError: naming the key and the reason.
    """
    size = shaped_numbers(data, key, (2,), name=name, label=label)
    if (size != np.floor(size)).any() or (size < 0).any() or (size > 1e6).any():
        raise CalibrationError(
            f"{name}: {label or key} must hold two whole numbers, [width, height] in pixels"
        )
    return int(size[0]), int(size[1])


def whole_number(value: PlainData, *, key: str, name: str) -> int:
    """One whole number from 0 to 1,000,000.

    Raises:
        CalibrationError: naming the key and the reason.
    """
    number = _number(value, key, name)
    if number != int(number) or not 0 <= number <= 1e6:
        raise CalibrationError(
            f"{name}: {key} must be a whole number from 0 to 1000000, not {str(value)[:40]}"
        )
    return int(number)


def _plain_array(value: PlainData, key: str, name: str) -> Float64Array:
    if isinstance(value, dict):
        raise CalibrationError(f"{name}: {key} must hold numbers, not further keys")
    items: list[PlainData] = list(value.split()) if isinstance(value, str) else value
    if len(items) > _MAX_NUMBERS:
        raise CalibrationError(
            f"{name}: {key} must hold at most {_MAX_NUMBERS} numbers, but it holds {len(items)}"
        )
    if items and all(isinstance(item, list) for item in items):
        rows = [_plain_array(item, key, name) for item in items]
        if len({row.shape for row in rows}) != 1 or rows[0].ndim != 1:
            raise CalibrationError(f"{name}: the rows of {key} must be of one length")
        return np.stack(rows)
    return np.array([_number(item, key, name) for item in items], dtype=np.float64)


def _number(value: PlainData, key: str, name: str) -> float:
    if not isinstance(value, str):
        raise CalibrationError(f"{name}: {key} must be a number where it holds further keys")
    text = value.strip()
    if _NUMBER.fullmatch(text):
        number = float(text)
        if math.isfinite(number):
            return number
    elif not _NOT_FINITE.fullmatch(text):
        raise CalibrationError(f"{name}: {key} must hold numbers only, not {text[:40]!r}")
    raise CalibrationError(f"{name}: {key} must hold finite numbers only, not {text[:40]}")
