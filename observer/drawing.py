"""Images to draw on; colours are BGR."""

from __future__ import annotations

import cv2
import numpy as np

from observer.types import Image, Unseen


def color_copy(image: Image) -> Image:
    """Return a BGR copy, (H, W, 3), of a grey or BGR image."""
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return image.copy()


# A thin stroke from edge to edge of each cell, mixed with the picture.
_HATCH, _HATCH_SHARE = (200, 120, 200), 0.5


def hatch_unseen(canvas: Image, unseen: Unseen) -> None:
    """Hatch where motion could not be noticed, on a BGR canvas of the left image's size."""
    side = unseen.cell_px
    corners = [
        (side * column, side * row)
        for row, letters in enumerate(unseen.rows)
        for column, letter in enumerate(letters)
        if letter != "."
    ]
    strokes = [np.array([(u, v + side), (u + side, v)], np.int32) for u, v in corners]
    drawn = canvas.copy()
    cv2.polylines(drawn, strokes, False, _HATCH, 1, cv2.LINE_AA)
    cv2.addWeighted(drawn, _HATCH_SHARE, canvas, 1 - _HATCH_SHARE, 0, dst=canvas)
