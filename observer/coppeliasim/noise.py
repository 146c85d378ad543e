"""The noise that a camera has and the simulator's drawing lacks.

Without it, two images of a scene at rest are the same to the last pixel, which no camera
delivers: such a camera is taken for frozen, and a robot would not be let drive by it.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.types import Image

# Standard deviation, grey levels: the simulated lab's.
SIGMA = 1.0
# Fresh numbers for every pixel would cost more than all else; a place in a stock is drawn.
_STOCK = 1 << 21
_SEED = 0xC0B


def noisy(image: Image, index: int, side: int) -> Image:
    """The image (H, W, 3) as a camera would give it: the same for the same frame and side."""
    stock = _stock()
    if image.size > len(stock) // 2:
        stock = np.tile(stock, 2 * image.size // len(stock) + 1)
    rng = np.random.default_rng([_SEED, index, side])
    start = int(rng.integers(0, len(stock) - image.size))
    noise = stock[start : start + image.size].reshape(image.shape)
    return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)


@cache
def _stock() -> NDArray[np.int8]:
    rng = np.random.default_rng(_SEED)
    noise = SIGMA * rng.standard_normal(_STOCK, dtype=np.float32)
    return np.asarray(np.rint(noise), np.int8)
