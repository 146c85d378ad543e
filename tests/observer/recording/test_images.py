"""Images as Foxglove messages, compared with Foxglove's own package."""

from __future__ import annotations

import numpy as np
import pytest
from foxglove import messages as fox
from hypothesis import given
from hypothesis import strategies as st

from observer.recording import foxglove
from observer.recording.images import field_head, message_fields, raw_pixels


@given(number=st.integers(1, 15), size=st.integers(0, 40_000))
def test_a_field_of_any_size_is_read_back(number: int, size: int) -> None:
    content = bytes(size)
    message = field_head(number, size) + content
    assert message_fields(memoryview(message)) == {number: memoryview(content)}


@pytest.mark.parametrize("shape", [(480, 640, 3), (480, 640), (3, 5, 3), (1, 1)])
def test_a_raw_image_has_the_fields_that_foxglove_writes(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(5).integers(0, 256, shape, np.uint8)
    height, width = shape[:2]
    channels = 1 if image.ndim == 2 else 3
    wanted = fox.RawImage(
        timestamp=foxglove.stamp(12_345_678_901),
        frame_id="camera_left",
        width=width,
        height=height,
        encoding="mono8" if channels == 1 else "bgr8",
        step=width * channels,
        data=image.tobytes(),
    ).encode()
    made = foxglove.raw_image(image, "left", 12_345_678_901)
    assert sorted(_plain(made)) == sorted(_plain(wanted))
    np.testing.assert_array_equal(raw_pixels(memoryview(made)), image)


def test_a_view_into_a_larger_image_is_written_correctly() -> None:
    both = np.random.default_rng(6).integers(0, 256, (6, 16, 3), np.uint8)
    right = both[:, 8:]
    made = foxglove.raw_image(right, "right", 0)
    np.testing.assert_array_equal(raw_pixels(memoryview(made)), right)


def _plain(message: bytes) -> list[tuple[int, bytes | int]]:
    return [
        (number, value if isinstance(value, int) else bytes(value))
        for number, value in message_fields(memoryview(message)).items()
    ]
