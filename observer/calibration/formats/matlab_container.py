"""MATLAB's MAT-files of level 5 (``save -v6`` and ``-v7``), as far as calibrations need them.

Read in Python, as every byte of an upload is somebody else's: lengths are checked before use, what
is compressed may not grow without bound, and arrays claim no memory that the file does not fill.
Format: MathWorks, "MAT-File Format".
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from observer.errors import CalibrationError
from observer.geometry import Float64Array

# What a session of a calibration app holds beside the calibration (corners, errors) is a few MB.
_MAX_EXPANDED_BYTES = 16_000_000
_MAX_DEPTH = 16
_HEADER_BYTES = 128

_MATRIX, _COMPRESSED = 14, 15
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"}
_NUMBER_TYPES |= {12: "i8", 13: "u8"}
_TEXT_TYPES = {1: "latin-1", 2: "latin-1", 16: "utf-8"}
_WIDE_TEXT_TYPES = {4: "utf-16", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _CHAR, _OPAQUE = 1, 2, 4, 17
_NUMBER_CLASSES = range(6, 16)


@dataclass(frozen=True)
class MatlabObject:
    """An object of a class, whose properties stand elsewhere in the file."""

    class_name: str


# A 1x1 struct is a mapping; what calibrations need none of is None.
MatlabValue: TypeAlias = (
    "Float64Array | str | dict[str, MatlabValue] | list[MatlabValue] | MatlabObject | None"
)


def read_matlab_variables(content: bytes, *, name: str) -> dict[str, MatlabValue]:
    """The variables of a MAT-file of level 5.

    Numbers become float64 arrays in MATLAB's shape, text becomes str, a struct a dict, a cell
    array or a struct array a list. Under the empty name stands what objects of classes keep their
    properties in, where there are any.

    Raises:
        CalibrationError: the file is cut off, damaged, too large once expanded or too deep.
    """
    if len(content) < _HEADER_BYTES or content[126:128] not in (b"IM", b"MI"):
        raise CalibrationError(f"{name}: the MAT-file is cut off or damaged in its header")
    order = "<" if content[126:128] == b"IM" else ">"
    reader = _Reader(name, order)
    variables = {}
    for kind, data in reader.elements(content[_HEADER_BYTES:]):
        if kind == _COMPRESSED:
            inner = list(reader.elements(reader.expanded(data)))
            if len(inner) != 1:
                raise reader.damaged("a compressed part must hold one variable")
            kind, data = inner[0]
        if kind != _MATRIX:
            raise reader.damaged("it holds something else than variables")
        title, value = reader.matrix(data, 0)
        variables[title] = value
    return variables


def check_object_data(variables: dict[str, MatlabValue], *, name: str) -> None:
    """Hold what objects keep their properties in to the same rules as the file.

    It is a MAT-file within the file, without the text at its beginning.

    Raises:
        CalibrationError: as ``read_matlab_variables``.
    """
    inner = variables.get("")
    if not isinstance(inner, np.ndarray) or not ((inner >= 0) & (inner <= 255)).all():
        raise CalibrationError(f"{name}: the MAT-file has no properties of its objects")
    content = inner.reshape(-1, order="F").astype(np.uint8).tobytes()
    reader = _Reader(name, "<" if content[2:4] == b"IM" else ">")
    for kind, data in reader.elements(content[8:]):
        if kind == _MATRIX:
            reader.matrix(data, 0)


class _Reader:
    def __init__(self, name: str, order: str) -> None:
        self._name = name
        self._order = order
        self._expanded = 0

    def damaged(self, reason: str) -> CalibrationError:
        return CalibrationError(f"{self._name}: the MAT-file is cut off or damaged: {reason}")

    def expanded(self, data: memoryview) -> bytes:
        left = _MAX_EXPANDED_BYTES - self._expanded
        try:
            content = zlib.decompressobj().decompress(data, left + 1)
        except zlib.error:
            raise self.damaged("a compressed part cannot be expanded") from None
        if len(content) > left:
            raise CalibrationError(
                f"{self._name}: the MAT-file is larger than {_MAX_EXPANDED_BYTES} bytes once "
                f"expanded; save the stereo parameters alone"
            )
        self._expanded += len(content)
        return content

    def elements(self, content: bytes | memoryview) -> Iterator[tuple[int, memoryview]]:
        """Type and data of each element; all but compressed data are padded to eight bytes."""
        view = memoryview(content)
        at = 0
        while at < len(view):
            if len(view) - at < 8:
                raise self.damaged("its last part is incomplete")
            kind, length = struct.unpack_from(self._order + "II", view, at)
            if kind >> 16:
                # Up to four bytes stand within the tag itself.
                kind, length = kind & 0xFFFF, kind >> 16
                if length > 4:
                    raise self.damaged("a short part is longer than four bytes")
                yield kind, view[at + 4 : at + 4 + length]
                at += 8
                continue
            at += 8
            if length > len(view) - at:
                raise self.damaged("a part is longer than the file")
            yield kind, view[at : at + length]
            at += length if kind == _COMPRESSED else length + -length % 8

    def matrix(self, data: memoryview, depth: int) -> tuple[str, MatlabValue]:
        """Name and value of a variable, a field or an element."""
        if depth > _MAX_DEPTH:
            raise CalibrationError(f"{self._name}: the MAT-file is nested too deeply")
        if not len(data):
            return "", np.zeros((0, 0))
        parts = self.elements(data)
        flags = self._whole_numbers(self._next(parts))
        if len(flags) != 2:
            raise self.damaged("a variable has no class")
        kind = flags[0] & 0xFF
        if kind == _OPAQUE:
            title, _, class_name = (self._text(self._next(parts)) for _ in range(3))
            for each in parts:
                self._value(each, depth)
            return title, MatlabObject(class_name)
        shape = tuple(self._whole_numbers(self._next(parts)))
        title = self._text(self._next(parts))
        if kind in _NUMBER_CLASSES:
            return title, self._array(shape, self._numbers(self._next(parts)))
        if kind == _CHAR:
            return title, self._text(self._next(parts))
        if kind == _STRUCT:
            return title, self._struct(shape, parts, depth)
        if kind == _CELL:
            values = [self._value(each, depth) for each in parts]
            self._check_count(shape, len(values))
            return title, values
        return title, None

    def _struct(
        self, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], depth: int
    ) -> MatlabValue:
        lengths = self._whole_numbers(self._next(parts))
        length = lengths[0] if len(lengths) == 1 else 0
        names = bytes(self._next(parts)[1])
        if length <= 0 or len(names) % length:
            raise self.damaged("the names of a struct's fields are not of one length")
        fields = [
            names[at : at + length].split(b"\0")[0].decode("latin-1")
            for at in range(0, len(names), length)
        ]
        values = [self._value(each, depth) for each in parts]
        if not fields and not values:
            return {}
        if not fields or len(values) % len(fields):
            raise self.damaged("a struct has not as many values as fields")
        structs: list[MatlabValue] = [
            dict(zip(fields, values[at : at + len(fields)], strict=True))
            for at in range(0, len(values), len(fields))
        ]
        self._check_count(shape, len(structs))
        return structs[0] if len(structs) == 1 else structs

    def _value(self, part: tuple[int, memoryview], depth: int) -> MatlabValue:
        kind, data = part
        if kind != _MATRIX:
            raise self.damaged("a field or an element is no array")
        return self.matrix(data, depth + 1)[1]

    def _next(self, parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
        part = next(parts, None)
        if part is None:
            raise self.damaged("a variable is incomplete")
        return part

    def _numbers(self, part: tuple[int, memoryview]) -> Float64Array:
        kind, data = part
        if kind not in _NUMBER_TYPES:
            raise self.damaged("numbers are of an unknown type")
        dtype = np.dtype(self._order + _NUMBER_TYPES[kind])
        if len(data) % dtype.itemsize:
            raise self.damaged("numbers are cut off")
        with np.errstate(invalid="ignore"):
            return np.frombuffer(data, dtype).astype(np.float64)

    def _whole_numbers(self, part: tuple[int, memoryview]) -> list[int]:
        numbers = self._numbers(part)
        if not np.isfinite(numbers).all():
            raise self.damaged("a length is no number")
        return [int(number) for number in numbers]

    def _array(self, shape: tuple[int, ...], numbers: Float64Array) -> Float64Array:
        self._check_count(shape, len(numbers))
        return numbers.reshape(shape, order="F")

    def _check_count(self, shape: tuple[int, ...], count: int) -> None:
        """Refuse arrays that claim to be larger than the file, which a reader might believe."""
        if not 1 <= len(shape) <= 32 or min(shape) < 0 or math.prod(shape) != count:
            raise self.damaged("an array has not as many elements as its shape says")

    def _text(self, part: tuple[int, memoryview]) -> str:
        kind, data = part
        encoding = _TEXT_TYPES.get(kind)
        if encoding is None:
            if kind not in _WIDE_TEXT_TYPES:
                raise self.damaged("text is of an unknown type")
            encoding = _WIDE_TEXT_TYPES[kind] + ("-le" if self._order == "<" else "-be")
        return bytes(data).decode(encoding, errors="replace")
