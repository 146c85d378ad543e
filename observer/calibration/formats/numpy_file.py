"""NumPy's ``.npz`` archives as plain data, for calibrations that Python programs saved.

Format: numpy.lib.format. Parsed here, because ``numpy.load`` reserves whatever memory an array's
head claims.
"""

from __future__ import annotations

import io
import lzma
import math
import tokenize
import zipfile
import zlib
from typing import BinaryIO, cast

import numpy as np
from numpy.lib import format as npy

from observer.errors import CalibrationError
from observer.text_files import PlainData

_ARRAY = ".npy"
# More numbers than any key of a calibration holds: points, maps and images are left out.
_MOST_NUMBERS = 64

# What the modules that read archives and the heads of arrays raise on damaged ones; RuntimeError
# includes methods and versions that are not implemented.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    tokenize.TokenError,
    TypeError,
    ValueError,
    EOFError,
    OSError,
    RuntimeError,
)


def is_numpy(content: bytes) -> bool:
    """Return whether a file is an archive that holds arrays only."""
    try:
        names = zipfile.ZipFile(io.BytesIO(content)).namelist()
    except _DAMAGED:
        return False
    return bool(names) and all(name.endswith(_ARRAY) for name in names)


def numpy_data(name: str, content: bytes) -> dict[str, PlainData]:
    """Return the small numeric arrays of an archive by their names, every number as text.

    Raises:
        CalibrationError: the archive is damaged.
    """
    data: dict[str, PlainData] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            for member in archive.namelist():
                with archive.open(member) as file:
                    array = _array(cast(BinaryIO, file))
                if array is not None:
                    data[member.removesuffix(_ARRAY)] = _plain(array.tolist())
    except _DAMAGED as error:
        raise CalibrationError(f"{name}: the archive is damaged: {error}") from None
    return data


def _array(file: BinaryIO) -> np.ndarray[tuple[int, ...], np.dtype[np.generic]] | None:
    """Return an array; None if it holds other things than numbers, or too many."""
    version = npy.read_magic(file)
    read_head = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, is_fortran, kind = read_head(file)
    count = math.prod(shape)
    if min(shape, default=0) < 0:
        raise ValueError("an array has a negative size")
    if kind.kind not in "iuf" or count > _MOST_NUMBERS:
        return None
    data = file.read(count * kind.itemsize)
    if len(data) < count * kind.itemsize:
        raise ValueError("an array is truncated")
    return np.frombuffer(data, kind).reshape(shape, order="F" if is_fortran else "C")


def _plain(value: object) -> PlainData:
    return [_plain(each) for each in value] if isinstance(value, list) else repr(value)
