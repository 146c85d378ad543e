"""Image noise, which the simulator's rendering lacks.

Without it, two images of a static scene are identical, which never happens with a real camera: the
camera would be taken for frozen, and no robot would be allowed to drive by it.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.types import Image

# Standard deviation, grey levels, as in the simulated lab.
SIGMA = 1.0
# Drawing new numbers for every pixel would cost more than everything else, so each image reads them
# from a random offset in a precomputed stock.
_STOCK = 1 << 21
_SEED = 0xC0B


def noisy(image: Image, index: int, side: int) -> Image:
    """Add noise to an image (H, W, 3); the same frame and side get the same noise."""
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
