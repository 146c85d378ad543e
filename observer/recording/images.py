"""Reader of images in a recording's messages.

It implements the part of protobuf's wire format (https://protobuf.dev/programming-guides/encoding)
that they use, so that reading a recording does not need Foxglove's package.
"""

from __future__ import annotations

import cv2
import numpy as np

from observer.errors import SourceError
from observer.types import Image

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
# Of the ten bytes that a number may have; an endless one must not be read forever.
_VARINT_BITS = 70
# Field numbers in foxglove/RawImage.proto and foxglove/CompressedImage.proto.
_RAW_WIDTH, _RAW_HEIGHT, _RAW_ENCODING, _RAW_STEP, RAW_DATA = 2, 3, 4, 5, 6
_JPEG_DATA = 2
_DAMAGED_JPEG = "a JPEG image of the recording is damaged"


def raw_pixels(message: memoryview) -> Image:
    """Return the pixels of a ``RawImage``, (H, W) grey or (H, W, 3) BGR.

    Raises:
        SourceError: the message is damaged or of another kind of image.
    """
    fields = message_fields(message)
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
        raise SourceError("an image of the recording is damaged or neither grey nor BGR")
    pixels = np.frombuffer(data, np.uint8)
    return pixels.reshape((height, width) if channels == 1 else (height, width, 3))


def jpeg_pixels(message: memoryview) -> Image:
    """Return the pixels of a ``CompressedImage``, (H, W) grey or (H, W, 3) BGR.

    Raises:
        SourceError: the message is damaged.
    """
    data = jpeg_data(message)
    # OpenCV raises its own error for an empty buffer.
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if found is None:
        raise SourceError(_DAMAGED_JPEG)
    return np.asarray(found, dtype=np.uint8)


def jpeg_data(message: memoryview) -> memoryview:
    """Return the JPEG bytes of a ``CompressedImage``.

    Raises:
        SourceError: the message is damaged.
    """
    data = message_fields(message).get(_JPEG_DATA)
    if not isinstance(data, memoryview):
        raise SourceError(_DAMAGED_JPEG)
    return data


def message_fields(message: memoryview) -> dict[int, int | memoryview]:
    """Return the fields of a message: value or bytes by number in the ``.proto`` file.

    Raises:
        SourceError: the message is damaged.
    """
    found: dict[int, int | memoryview] = {}
    at = 0
    try:
        while at < len(message):
            tag, at = _varint(message, at)
            number, wire = tag >> 3, tag & 7
            if wire == _VARINT:
                found[number], at = _varint(message, at)
                continue
            if wire == _BYTES:
                size, at = _varint(message, at)
            elif wire in (_FIXED32, _FIXED64):
                size = 4 if wire == _FIXED32 else 8
            else:
                raise SourceError("a message of the recording is damaged")
            part = message[at : at + size]
            if len(part) != size:
                raise SourceError("a message of the recording is truncated")
            at += size
            found[number] = part if wire == _BYTES else int.from_bytes(part, "little")
    except IndexError:
        raise SourceError("a message of the recording is truncated") from None
    return found


def field_head(number: int, size: int) -> bytes:
    """Return the bytes that precede the content of a field.

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
        if shift >= _VARINT_BITS:
            raise SourceError("a message of the recording is damaged")


def _bytes(value: int | memoryview | None) -> bytes:
    return bytes(value) if isinstance(value, memoryview) else b""
