"""Boxes in the rectified left image, of the ground truth and of the lines of ``observe``."""

from __future__ import annotations

import numpy as np

from observer.evaluation.lines import Unseen
from observer.geometry import Float64Array
from observer.types import BoxPx


def clipped(box: BoxPx, image_size: tuple[int, int]) -> BoxPx:
    """Return a box clipped to an image of this width and height."""
    ends = np.array([image_size, image_size]).ravel() - 0.5
    u0, v0, u1, v1 = np.clip(box, -0.5, ends).tolist()
    return u0, v0, u1, v1


def area(box: BoxPx) -> float:
    """Return the area of a box, px^2; 0 for an empty one."""
    return max(box[2] - box[0], 0.0) * max(box[3] - box[1], 0.0)


def box_iou(a: BoxPx, b: BoxPx) -> float:
    """Return the area of the intersection over that of the union, 0 to 1."""
    across = min(a[2], b[2]) - max(a[0], b[0])
    down = min(a[3], b[3]) - max(a[1], b[1])
    common = max(across, 0.0) * max(down, 0.0)
    union = area(a) + area(b) - common
    return common / union if union > 0 else 0.0


def unseen_share(box: BoxPx, unseen: Unseen) -> float:
    """Return the share of a box in which motion could not be noticed, 0 to 1."""
    whole = area(box)
    if whole <= 0:
        return 0.0
    cells = np.array([[letter != "." for letter in row] for row in unseen.rows], dtype=np.float64)
    rows, columns = cells.shape
    down = _overlaps(box[1], box[3], rows, unseen.cell_px)
    across = _overlaps(box[0], box[2], columns, unseen.cell_px)
    return float(down @ cells @ across) / whole


def _overlaps(low: float, high: float, count: int, cell_px: int) -> Float64Array:
    """Return the length (count,) of an interval in each cell, px; the first starts at -0.5."""
    edges = np.clip(np.arange(count + 1) * cell_px - 0.5, low, high)
    return np.diff(edges)
