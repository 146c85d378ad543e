"""Codec of Vicon Tracker's UDP Object Stream, without a socket.

Little-endian and packed: frame number (u32), number of items (u8); each item has an id (u8, 0 for
an object), its size (u16, 72 for an object) and that many bytes: a name of 24, then translation
(mm) and rotation (rad, intrinsic XYZ) as six f64. Padding follows the items.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

DEFAULT_PORT = 51001

_FRAME = struct.Struct("<IB")
_ITEM = struct.Struct("<BH")
_OBJECT = struct.Struct("<24s6d")
_OBJECT_ID = 0


class ViconStreamError(Exception):
    """Invalid datagram; one sentence."""


@dataclass(frozen=True)
class ViconObject:
    """An object in a datagram.

    Attributes:
        translation_mm: (x, y, z). rotation_rad: angles about X, Y, Z, intrinsic, in this order.
    """

    name: str
    translation_mm: tuple[float, float, float]
    rotation_rad: tuple[float, float, float]


def unpack_frame(data: bytes) -> tuple[int, tuple[ViconObject, ...]]:
    """Return a datagram's frame number and its objects; other kinds of items are skipped.

    Raises:
        ViconStreamError: it is truncated, or an object is too small.
    """
    if len(data) < _FRAME.size:
        raise ViconStreamError(f"a datagram must have at least {_FRAME.size} bytes")
    frame, count = _FRAME.unpack_from(data)
    objects = []
    begin = _FRAME.size
    for _ in range(count):
        if begin + _ITEM.size > len(data):
            raise ViconStreamError(f"{count} items are announced, but the datagram is truncated")
        kind, size = _ITEM.unpack_from(data, begin)
        begin += _ITEM.size
        if begin + size > len(data):
            raise ViconStreamError(f"an item announces {size} bytes, but is truncated")
        if kind == _OBJECT_ID:
            if size < _OBJECT.size:
                raise ViconStreamError(f"an object must have {_OBJECT.size} bytes, not {size}")
            name, *numbers = _OBJECT.unpack_from(data, begin)
            x, y, z, rx, ry, rz = numbers
            text = name.split(b"\0")[0].decode("utf-8", "replace")
            objects.append(ViconObject(text, (x, y, z), (rx, ry, rz)))
        begin += size
    return frame, tuple(objects)
