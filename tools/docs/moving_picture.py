"""Make the moving picture of README and documentation: both methods on the same frames.

    python -m tools.docs.moving_picture [F.webp]

Each half is a real observation of the simulated lab, as a notebook makes it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import observer
from observer.drawing import draw_text
from observer.types import Image as Picture
from tools import ROOT

PICTURE = ROOT / "docs" / "pages" / "images" / "paper-and-default.webp"
# The seed is fixed, so that the picture is the same each time.
_SOURCE = "simulated:lab?seed=7"
_PRESETS = ("paper", "default")
# The robot turns back, and the camera turns as well.
_FRAMES = range(56, 152, 2)
_HEIGHT_PX = 208
_WHITE = (255, 255, 255)
_LETTERS = 0.7
_QUALITY = 45
# Every second frame of 15 a second.
_DURATION_MS = 133


def pictures_of(preset: str) -> list[Picture]:
    """Return what a preset finds, (H, W, 3) RGB each, with its name in the corner."""
    pictures = []
    with observer.open(_SOURCE, preset=preset) as source:
        for step in source.steps(_FRAMES.stop):
            if step.frame.index in _FRAMES:
                picture = step.picture()
                draw_text(picture, preset, (8, 24), _WHITE, _LETTERS)
                pictures.append(picture)
    return pictures


def write(path: Path) -> None:
    """Observe with both presets and write what they find side by side, in real time."""
    halves = zip(*(pictures_of(preset) for preset in _PRESETS), strict=True)
    first, *others = [Image.fromarray(_small(np.hstack(each))) for each in halves]
    first.save(
        path, save_all=True, append_images=others, duration=_DURATION_MS, loop=0,
        quality=_QUALITY, method=6,
    )  # fmt: skip


def _small(picture: Picture) -> Picture:
    height, width = picture.shape[:2]
    size = (width * _HEIGHT_PX // height, _HEIGHT_PX)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE)
