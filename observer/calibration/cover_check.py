"""Test which camera is the left one: a person covers its lens, and one image goes dark."""

from __future__ import annotations

import math
from collections import deque
from typing import Literal

import numpy as np

from observer.geometry import Float64Array
from observer.types import Image

Covered = Literal["left", "right", "both"]

# Shares of the earlier brightness or contrast. A covered lens leaves less than the first of
# brightness, or of contrast if light shines through the fingers; the other camera keeps more than
# the second of both.
_DARK = 0.45
_KEPT = 0.7
# Consecutive looks that must agree: a passing hand is not an answer.
_LOOKS = 4
_REMEMBERED = 8
# Approximate number of samples on which an image is judged.
_SAMPLES = 4096


class CoverCheck:
    """Comparison of each image with those from before the question was asked."""

    def __init__(self) -> None:
        self._before: deque[Float64Array] = deque(maxlen=_REMEMBERED)
        self._reference: Float64Array | None = None
        self._latest: deque[Covered | None] = deque(maxlen=_LOOKS)
        self.answer: Covered | None = None

    @property
    def asked(self) -> bool:
        """True while somebody waits for the answer."""
        return self._reference is not None

    def ask(self) -> None:
        """Take a lens that is covered from now on as the answer; forget an earlier answer."""
        self.answer = None
        self._latest.clear()
        before = list(self._before)
        self._reference = np.median(before, axis=0) if before else np.full((2, 2), math.nan)

    def end(self) -> None:
        """End the question."""
        self._reference = None
        self.answer = None

    def look(self, left: Image, right: Image) -> None:
        """Judge one pair of images as taken, (H, W) grey or (H, W, 3) BGR."""
        now = np.array([_brightness_and_contrast(left), _brightness_and_contrast(right)])
        self._before.append(now)
        if self._reference is None:
            return
        if np.isnan(self._reference).any():
            self._reference = now
        share = (now / np.maximum(self._reference, 1.0)).min(axis=1)
        self._latest.append(_covered(share))
        if len(self._latest) == _LOOKS and len(set(self._latest)) == 1:
            self.answer = self._latest[0] or self.answer


def _covered(share: Float64Array) -> Covered | None:
    dark, kept = share < _DARK, share > _KEPT
    if dark.all():
        return "both"
    if dark[0] and kept[1]:
        return "left"
    if dark[1] and kept[0]:
        return "right"
    return None


def _brightness_and_contrast(image: Image) -> tuple[float, float]:
    step = max(1, int((image.shape[0] * image.shape[1] / _SAMPLES) ** 0.5))
    samples = image[::step, ::step]
    return float(samples.mean()), float(samples.std())
