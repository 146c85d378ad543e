"""Damaged image files: an image or a one-sentence error, and no memory for missing pixels."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from observer.errors import SourceError
from observer.image_files.listing import read_times
from observer.image_files.reading import decoded_image

from ...damage import damaged, examples, hostile_bytes, read_or_refused

GREY = np.random.default_rng(0).integers(0, 256, (12, 16), np.uint8)
DEEP = GREY.astype(np.uint16) * 16
FORMATS = (".png", ".jpg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp")


def encoded(extension: str, image: np.ndarray) -> bytes:
    ok, content = cv2.imencode(extension, image)
    assert ok
    return content.tobytes()


COLOUR = np.dstack([GREY, GREY, GREY])
SAMPLES = (
    *(encoded(extension, COLOUR) for extension in FORMATS if extension != ".pgm"),
    *(encoded(extension, GREY) for extension in FORMATS if extension != ".ppm"),
    *(encoded(extension, DEEP) for extension in (".png", ".pgm", ".tif")),
)


def png(width: int, height: int, data: bytes = b"\0") -> bytes:
    """Return a complete PNG that claims to have this size."""
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
              (b"IDAT", zlib.compress(data)), (b"IEND", b""))  # fmt: skip
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def bmp(width: int, height: int) -> bytes:
    """Return a BMP without pixels that claims to have this size."""
    head = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 14 + len(head), 0, 0, 54) + head


@examples(100)
@given(
    content=damaged(SAMPLES, (b"P5\n", b"P6 ", b"#", b" 255\n", b"IEND")) | hostile_bytes(SAMPLES),
    grey=st.booleans(),
)
@example(b"P5\n" + b"9" * 5000 + b" 1\n255\n", False)
@example(b"P6 60000 60000 255\n\0", False)
@example(png(30_000, 30_000), False)
@example(png(16_384, 65_535), True)
@example(bmp(30_000, 30_000), False)
@example(bmp(-2147483648, -2147483648), False)
@example(b"II*\0\x08\0\0\0\0\0", False)
def test_a_damaged_file_is_refused_or_gives_an_image(content: bytes, grey: bool) -> None:
    image = read_or_refused(
        lambda: decoded_image(content, name="left/1.png", grey=grey), SourceError
    )
    if image is not None:
        assert image.dtype == np.uint8
        assert image.size
        assert image.ndim == 2 if grey else image.ndim in (2, 3)


@pytest.mark.parametrize("image", [GREY, COLOUR], ids=["grey", "colour"])
@pytest.mark.parametrize("extension", [".png", ".bmp", ".tif", ".webp"])
def test_losslessly_written_images_are_read_unchanged(extension: str, image: np.ndarray) -> None:
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if extension == ".webp" else []
    ok, content = cv2.imencode(extension, image, options)
    assert ok
    read = decoded_image(content.tobytes(), name="a")
    assert np.array_equal(read if read.ndim == image.ndim else read[:, :, 0], image)


@examples(60)
@given(content=damaged([b"# times\n0.0\n0.066667\n1.3e-1\n\n2\n"]) | hostile_bytes((b"0.5", b"\n")))
@example(b"1_000\n")
@example("٣\n".encode())
def test_times_are_finite_plain_numbers_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "times.txt"
    path.write_bytes(content)
    times = read_or_refused(lambda: read_times(path), SourceError)
    if times is not None:
        assert np.isfinite(times).all()
        # Python parses underscores in numbers, but files do not contain them.
        told = [each for each in content.splitlines() if not each.strip().startswith(b"#")]
        assert b"_" not in b"".join(told)


@examples(24)
@given(st.lists(st.floats(0, 1e6), max_size=20))
def test_times_are_read_back_with_full_precision(
    tmp_path_factory: pytest.TempPathFactory, times: list[float]
) -> None:
    path: Path = tmp_path_factory.getbasetemp() / "written.txt"
    path.write_text("".join(f"{each!r}\n" for each in times))
    assert read_times(path) == times
