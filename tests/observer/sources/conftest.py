"""Synthetic recorded stereo: each pair's images encode its number and side."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.types import Image

WIDTH, HEIGHT = 64, 48

MakeImage = Callable[..., Image]


def marked_image(number: int, side: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Image:
    """Return noise of mean 40 + 4 * number, plus 20 on the right; it survives compression."""
    width, height = size
    noise = np.random.default_rng(number).integers(-20, 21, (height, width))
    level = 40 + 4 * number + (20 if side == "right" else 0)
    return np.clip(level + noise, 0, 255).astype(np.uint8)


def write_image(path: Path, image: Image) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


@pytest.fixture
def make_image() -> MakeImage:
    """Return ``marked_image(number, side, size)``."""
    return marked_image


@pytest.fixture
def stereo_folder(tmp_path: Path) -> Path:
    """A stereo folder with five pairs at 10 Hz and no calibration."""
    for number in range(5):
        for side in ("left", "right"):
            write_image(tmp_path / side / f"{number:06d}.png", marked_image(number, side))
    (tmp_path / "times.txt").write_text("".join(f"{number * 0.1}\n" for number in range(5)))
    return tmp_path
