"""Image files: truncation is noticed anywhere, in every format."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import SourceError
from observer.image_files.reading import BitDepth, damage, decoded_image, read_image

NOISE = np.random.default_rng(0).integers(0, 255, (40, 60), dtype=np.uint8)
FORMATS = (".png", ".jpg", ".pgm", ".bmp", ".webp")
PROGRESSIVE = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]


def encoded(extension: str, image: np.ndarray = NOISE, options: list[int] | None = None) -> bytes:
    ok, content = cv2.imencode(extension, image, options or [])
    assert ok
    return content.tobytes()


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("grey", [True, False])
def test_sixteen_bit_images_are_scaled_by_the_bits_in_use(bits: int, grey: bool) -> None:
    deep = NOISE.astype(np.uint16) << (bits - 8)
    deep[0, 0] = (1 << bits) - 1
    content = cv2.imencode(".png", deep)[1].tobytes()
    read = decoded_image(content, name="deep.png", grey=grey)
    assert read.dtype == np.uint8
    assert np.array_equal(read[1:], NOISE[1:])


def test_a_dark_image_is_scaled_like_earlier_bright_ones() -> None:
    depth, bright = BitDepth(), np.full((4, 5), 4000, np.uint16)
    assert depth.reduced(bright)[0, 0] == 250
    assert depth.reduced(bright // 16)[0, 0] == 15
    assert BitDepth().reduced(bright // 16)[0, 0] == 250


@pytest.mark.parametrize("extension", [".png", ".pgm", ".bmp"])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_written_image_is_read_back(extension: str, channels: int, tmp_path: Path) -> None:
    image = NOISE if channels == 1 else np.dstack([NOISE, NOISE[::-1], 255 - NOISE])
    path = tmp_path / ("a.ppm" if (extension, channels) == (".pgm", 3) else f"a{extension}")
    assert cv2.imwrite(str(path), image)
    read = read_image(path)
    assert read.dtype == np.uint8
    # An 8-bit bitmap has a palette, so its decoder returns colour.
    assert np.array_equal(read if read.ndim == image.ndim else read[..., 0], image)


def test_sixteen_bit_images_keep_their_upper_eight_bits(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "deep.png"), NOISE.astype(np.uint16) * 256 + 7)
    assert np.array_equal(read_image(tmp_path / "deep.png"), NOISE)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_refused(extension: str, share: float, tmp_path: Path) -> None:
    whole = encoded(extension)
    path = tmp_path / "left" / f"000003{extension}"
    path.parent.mkdir()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(SourceError, match=rf"^left/000003\{extension} (is|cannot)") as caught:
        read_image(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("options", [[], PROGRESSIVE])
@given(length=st.integers(3, 3000))
@settings(max_examples=60)
def test_any_truncation_of_a_jpeg_is_noticed(options: list[int], length: int) -> None:
    whole = encoded(".jpg", options=options)
    assert damage(whole) is None
    if length < len(whole) - 1:
        assert damage(whole[:length])


@pytest.mark.parametrize("options", [[], PROGRESSIVE])
@given(share=st.floats(0.0, 0.99), between=st.sampled_from([b"", b"\r\n--b\r\nA: b\r\n\r\n"]))
@settings(max_examples=60)
def test_a_jpeg_that_another_one_cuts_off_is_damaged(
    options: list[int], share: float, between: bytes
) -> None:
    whole = encoded(".jpg", options=options)
    assert damage(whole + between + whole) is None
    frame = whole.index(b"\xff\xc2" if options else b"\xff\xc0") + 4
    assert damage(whole[: frame + int((len(whole) - frame) * share)] + between + whole)


@given(position=st.integers(8, 2000), value=st.integers(1, 255))
@settings(max_examples=100)
def test_any_changed_byte_of_a_png_is_noticed(position: int, value: int) -> None:
    content = bytearray(encoded(".png"))
    content[min(position, len(content) - 1)] ^= value
    assert damage(bytes(content))


def test_trailing_bytes_are_not_damage() -> None:
    for extension in FORMATS:
        assert damage(encoded(extension) + b"\0" * 40) is None


@given(st.binary(max_size=60) | st.builds(lambda b: b"\xff\xd8" + b, st.binary(max_size=60))
       | st.builds(lambda b: b"\x89PNG\r\n\x1a\n" + b, st.binary(max_size=60))
       | st.builds(lambda b: b"P5 " + b, st.binary(max_size=60)))  # fmt: skip
@settings(max_examples=200)
def test_damage_accepts_any_bytes(content: bytes) -> None:
    problem = damage(content)
    assert problem is None or problem.startswith("is ")


def test_an_unreadable_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "note.png").write_text("this is no image at all")
    with pytest.raises(SourceError, match=r"note\.png is damaged or not an image"):
        read_image(tmp_path / "note.png")
    with pytest.raises(SourceError, match=r"absent\.png is missing"):
        read_image(tmp_path / "absent.png")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(SourceError, match=r"folder\.png cannot be read"):
        read_image(tmp_path / "folder.png")
