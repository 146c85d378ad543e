"""Reading of one image from one file, or one sentence that says why it cannot be read.

``cv2.imread`` returns whatever it could decode of a truncated JPEG, grey from some row on, and
such an image gives plausible but wrong motion. So the container is checked to its end before
decoding.
"""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.errors import SourceError
from observer.types import Image

IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp"}
)

# Bit depths of cameras; 16-bit files hold them in their lower bits.
_BITS = (8, 10, 12, 14, 16)

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
# JPEG segments without a length: TEM, RSTn, SOI.
_JPEG_BARE = frozenset({0x01, *range(0xD0, 0xD9)})
_JPEG_START_OF_SCAN = 0xDA
_JPEG_STARTS_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_END = b"\xff\xd9"
# Inside compressed data 00 follows every FF, so anything but RSTn is the marker after it.
_JPEG_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


class BitDepth:
    """Number of bits in use in a source's 16-bit images: 10-, 12- and 14-bit cameras store 16.

    The highest number seen so far counts, so that a dark image does not come out brighter.
    """

    def __init__(self) -> None:
        self._bits = 0

    def reduced(self, image: NDArray[np.uint16]) -> Image:
        """Return the upper 8 of the bits in use; the image may have any shape."""
        highest = int(image.max(initial=0))
        self._bits = max(self._bits, next(bits for bits in _BITS if highest < 1 << bits))
        return (image >> (self._bits - 8)).astype(np.uint8)


def read_image(path: Path, depth: BitDepth | None = None) -> Image:
    """The image as stored: (H, W) grey or (H, W, 3) BGR uint8; of 16 bits the upper 8 in use.

    Args:
        depth: of the image's source; None judges the image alone.

    Raises:
        SourceError: the file is missing, cut off, damaged or no image; names the file.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise SourceError(f"{_named(path)} is missing") from None
    except OSError as error:
        raise SourceError(f"{_named(path)} cannot be read: {error.strerror}") from None
    return decoded_image(content, name=_named(path), depth=depth)


def decoded_image(
    content: bytes, *, name: str, grey: bool = False, depth: BitDepth | None = None
) -> Image:
    """The image that a file holds, as ``read_image`` gives it; ``grey`` makes it (H, W).

    Raises:
        SourceError: it is cut off, damaged or no image; the sentence begins with ``name``.
    """
    problem = damage(content)
    if problem:
        raise SourceError(f"{name} {problem}")
    flag = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_ANYCOLOR
    image = _decoded(content, flag | cv2.IMREAD_ANYDEPTH)
    if image is not None and image.dtype == np.uint16:
        return (depth or BitDepth()).reduced(np.asarray(image, np.uint16))
    if image is not None and image.dtype != np.uint8:
        image = _decoded(content, flag)
    if image is None:
        raise SourceError(f"{name} is damaged or not an image that OpenCV can decode")
    return np.asarray(image, dtype=np.uint8)


def _decoded(content: bytes, flag: int) -> NDArray[Any] | None:
    try:
        return cv2.imdecode(np.frombuffer(content, np.uint8), flag)
    except cv2.error:
        return None


def damage(content: bytes) -> str | None:
    """Return what is wrong with an image file as a container, or None; pixels are not decoded."""
    if not content:
        return "is empty"
    if content.startswith(_PNG):
        return _png_damage(content)
    if content.startswith(_JPEG):
        return _jpeg_damage(content)
    if content.startswith((b"P5", b"P6")):
        return _netpbm_damage(content)
    if content.startswith(b"BM") and len(content) >= 6:
        declared = int.from_bytes(content[2:6], "little")
        return _cut_off(declared, len(content))
    if content.startswith(b"RIFF") and content[8:12] == b"WEBP":
        return _cut_off(int.from_bytes(content[4:8], "little") + 8, len(content))
    return None


def _png_damage(content: bytes) -> str | None:
    position = len(_PNG)
    while position + 12 <= len(content):
        length = int.from_bytes(content[position : position + 4], "big")
        end = position + 12 + length
        if end > len(content):
            break
        checked = content[position + 4 : end - 4]
        if zlib.crc32(checked) != int.from_bytes(content[end - 4 : end], "big"):
            return "is damaged: a PNG checksum does not match"
        if checked.startswith(b"IEND"):
            return None
        position = end
    return "is truncated: the PNG has no end marker"


def _jpeg_damage(content: bytes) -> str | None:
    cut_off = "is truncated: the JPEG has no end marker"
    position, has_frame = 2, False
    while position + 4 <= len(content):
        if content[position] != 0xFF:
            return "is damaged: a JPEG segment does not start where it should"
        marker = content[position + 1]
        if marker == 0xFF or marker in _JPEG_BARE:
            position += 1 if marker == 0xFF else 2
            continue
        position += 2 + int.from_bytes(content[position + 2 : position + 4], "big")
        if marker == _JPEG_START_OF_SCAN:
            after = _JPEG_AFTER_SCAN.search(content, position)
            if after is None:
                return cut_off
            if after[0] == _JPEG_END:
                return None
            position = after.start()
        elif marker in _JPEG_STARTS_OF_FRAME:
            if has_frame:
                return "is truncated: another JPEG begins before its end marker"
            has_frame = True
    return cut_off


def _netpbm_damage(content: bytes) -> str | None:
    header = re.match(rb"P([56])(?:\s|#[^\n]*\n)+(\d{1,9})\s+(\d{1,9})\s+(\d{1,9})\s", content)
    if header is None:
        return None  # unusual comments or no sizes; the decoder decides
    kind, *numbers = header.groups()
    width, height, maximum = map(int, numbers)
    channels = 3 if kind == b"6" else 1
    size = width * height * channels * (2 if maximum > 255 else 1)
    return _cut_off(header.end() + size, len(content))


def _cut_off(declared: int, actual: int) -> str | None:
    if actual >= declared:
        return None
    return f"is truncated: it should have {declared} bytes and has {actual}"


def _named(path: Path) -> str:
    # The folder tells left from right; the full path would be too long for the sentence.
    return "/".join(path.parts[-2:])
