"""Images out of a recording's messages.

Of Foxglove's messages only these are read back, and of protobuf's wire format
(https://protobuf.dev/programming-guides/encoding) only what they use, so reading a recording needs
no package of Foxglove.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from observer.errors import SourceError
from observer.types import Image

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
# Numbers of fields in foxglove/RawImage.proto and foxglove/CompressedImage.proto.
_RAW_WIDTH, _RAW_HEIGHT, _RAW_ENCODING, _RAW_STEP, RAW_DATA = 2, 3, 4, 5, 6
_JPEG_DATA, _JPEG_FORMAT = 2, 3


class Field(NamedTuple):
    """One field of a message: its number in the ``.proto`` file, and its value or bytes."""

    number: int
    value: int | memoryview


def raw_pixels(message: memoryview) -> Image:
    """(H, W) or (H, W, 3) BGR of a ``RawImage``.

    Raises:
        SourceError: the message is damaged or of another kind of image.
    """
    fields = {field.number: field.value for field in message_fields(message)}
    width, height, step = (fields.get(n) for n in (_RAW_WIDTH, _RAW_HEIGHT, _RAW_STEP))
    data, encoding = fields.get(RAW_DATA), fields.get(_RAW_ENCODING)
    channels = {b"mono8": 1, b"bgr8": 3}.get(_bytes(encoding))
    if (
        channels is None
        or not isinstance(width, int)
        or not isinstance(height, int)
        or step != width * channels
        or not isinstance(data, memoryview)
        or len(data) != height * width * channels
    ):
        raise SourceError("an image of the recording is neither grey nor BGR, or it is damaged")
    pixels = np.frombuffer(data, np.uint8)
    return pixels.reshape((height, width) if channels == 1 else (height, width, 3))


def jpeg_pixels(message: memoryview) -> Image:
    """(H, W) or (H, W, 3) BGR of a ``CompressedImage``.

    Raises:
        SourceError: the message is damaged.
    """
    fields = {field.number: field.value for field in message_fields(message)}
    data = fields.get(_JPEG_DATA)
    # OpenCV answers an empty buffer with an error of its own.
    found = None
    if isinstance(data, memoryview) and len(data):
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None:
        raise SourceError("a JPEG image of the recording is damaged")
    return np.asarray(found, dtype=np.uint8)


def message_fields(message: memoryview) -> list[Field]:
    """The fields of a message, in order.

    Raises:
        SourceError: the message is damaged.
    """
    found, at = [], 0
    try:
        while at < len(message):
            tag, at = _varint(message, at)
            number, wire = tag >> 3, tag & 7
            if wire == _VARINT:
                value, at = _varint(message, at)
                found.append(Field(number, value))
                continue
            if wire == _BYTES:
                size, at = _varint(message, at)
            elif wire in (_FIXED32, _FIXED64):
                size = 4 if wire == _FIXED32 else 8
            else:
                raise SourceError("a message of the recording is damaged")
            part = message[at : at + size]
            if len(part) != size:
                raise SourceError("a message of the recording is cut off")
            at += size
            found.append(Field(number, part if wire == _BYTES else int.from_bytes(part, "little")))
    except IndexError:
        raise SourceError("a message of the recording is cut off") from None
    return found


def field_head(number: int, size: int) -> bytes:
    """What stands before the bytes of a field.

    Args:
        number: of the field in the ``.proto`` file. size: bytes.
    """
    head = bytearray([number << 3 | _BYTES])
    while size > 0x7F:
        head.append(size & 0x7F | 0x80)
        size >>= 7
    head.append(size)
    return bytes(head)


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at


def _bytes(value: int | memoryview | None) -> bytes:
    return bytes(value) if isinstance(value, memoryview) else b""
