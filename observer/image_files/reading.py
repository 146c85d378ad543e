"""One image out of one file, or one sentence that says why not.

``cv2.imread`` hands out what it could decode of a cut-off JPEG, grey from some row on, and such
an image gives plausible wrong motion. So the container is checked to its end before decoding.
"""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import cv2
import numpy as np

from observer.errors import SourceError
from observer.types import Image

IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp"}
)

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
# JPEG segments without a length: TEM, RSTn, SOI.
_JPEG_BARE = frozenset({0x01, *range(0xD0, 0xD9)})
_JPEG_START_OF_SCAN = 0xDA


def read_image(path: Path) -> Image:
    """The image as stored: (H, W) grey or (H, W, 3) BGR uint8; 16 bit images keep the upper 8.

    Raises:
        SourceError: the file is missing, cut off, damaged or no image; names the file.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise SourceError(f"{_named(path)} is missing") from None
    except OSError as error:
        raise SourceError(f"{_named(path)} cannot be read: {error.strerror}") from None
    return decoded_image(content, name=_named(path))


def decoded_image(content: bytes, *, name: str, grey: bool = False) -> Image:
    """The image that a file holds, as ``read_image`` gives it; ``grey`` makes it (H, W).

    Raises:
        SourceError: it is cut off, damaged or no image; the sentence begins with ``name``.
    """
    problem = damage(content)
    if problem:
        raise SourceError(f"{name} {problem}")
    flag = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_ANYCOLOR
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flag)
    except cv2.error:
        image = None
    if image is None:
        raise SourceError(f"{name} is damaged or no image that OpenCV can decode")
    return np.asarray(image, dtype=np.uint8)


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
    return "is cut off: the PNG has no end"


def _jpeg_damage(content: bytes) -> str | None:
    cut_off = "is cut off: the JPEG has no end"
    position = 2
    while position + 4 <= len(content):
        if content[position] != 0xFF:
            return "is damaged: a JPEG segment does not begin where it should"
        marker = content[position + 1]
        if marker == 0xFF or marker in _JPEG_BARE:
            position += 1 if marker == 0xFF else 2
            continue
        if marker == _JPEG_START_OF_SCAN:
            # Inside compressed data every FF is escaped, so an end mark is one.
            return None if content.find(b"\xff\xd9", position) >= 0 else cut_off
        position += 2 + int.from_bytes(content[position + 2 : position + 4], "big")
    return cut_off


def _netpbm_damage(content: bytes) -> str | None:
    header = re.match(rb"P([56])(?:\s|#[^\n]*\n)+(\d+)\s+(\d+)\s+(\d+)\s", content)
    if header is None:
        return None  # unusual comments; the decoder decides
    kind, *numbers = header.groups()
    width, height, maximum = map(int, numbers)
    channels = 3 if kind == b"6" else 1
    size = width * height * channels * (2 if maximum > 255 else 1)
    return _cut_off(header.end() + size, len(content))


def _cut_off(declared: int, actual: int) -> str | None:
    if actual >= declared:
        return None
    return f"is cut off: it should have {declared} bytes and has {actual}"


def _named(path: Path) -> str:
    # The folder tells left from right; the whole path would drown the sentence.
    return "/".join(path.parts[-2:])
