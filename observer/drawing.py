"""Images to draw on; colours are BGR."""

from __future__ import annotations

import cv2
import numpy as np

from observer.types import Image


def color_copy(image: Image) -> Image:
    """Return a BGR copy, (H, W, 3), of a grey or BGR image."""
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return image.copy()
