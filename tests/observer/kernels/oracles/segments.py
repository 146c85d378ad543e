"""Oracle of ``observer.kernels.segments``: the same by numpy and OpenCV."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.free_space import ARRIVED, STATIC

Mask = NDArray[np.bool_]

_PART_SHARE = 0.1
_RING_CELLS, _RIM_CELLS = 4, 1
_CUT_SHARE = 0.25
_BESIDE_CELLS = 3


@dataclass(frozen=True, eq=False)
class Scene:
    """Images (h, w) in which segments are found, and pixels per cell."""

    disparity: NDArray[np.float32]
    evidence: NDArray[np.uint8]
    standing: Mask
    reduction: int
    least_step: float
    least_tolerance: float
    thickness: float

    def tolerance(self, disparity: float) -> float:
        """Return the px of disparity by which parts of one body may differ."""
        return max(self.least_tolerance, disparity * disparity * self.thickness)


@dataclass(frozen=True, eq=False)
class Described:
    """A segment, see ``observer.kernels.segments.described``."""

    numbers: tuple[float, float, float, float]
    evidence: NDArray[np.int64]
    border: tuple[int, int, int]
    cut: tuple[bool, bool]


def window_of(mask: Mask, more: int = 0) -> tuple[slice, slice]:
    """Rows and columns of a mask (h, w), extended by ``more`` cells on each side."""
    column, row, width, height = cv2.boundingRect(mask.view(np.uint8))
    h, w = mask.shape
    return (
        slice(max(0, row - more), min(h, row + height + more)),
        slice(max(0, column - more), min(w, column + width + more)),
    )


def grown(scene: Scene, free: Mask, seed: Mask, may_be_static: Mask, disparity: float) -> Mask:
    """(h, w) the free cells at the seed's depth that are connected to it."""
    off = np.abs(scene.disparity - np.float32(disparity))
    alike = free & (off < np.float32(scene.tolerance(disparity)))
    alike &= (scene.evidence != STATIC) | may_be_static
    mask = np.zeros(free.shape, np.bool_)
    if not alike.any():
        return mask
    window = window_of(alike)
    square = np.ones((3, 3), np.uint8)
    part = np.ascontiguousarray(alike[window]).view(np.uint8)
    opened = cv2.morphologyEx(part, cv2.MORPH_OPEN, square)
    _, labels = cv2.connectedComponents(opened, connectivity=4)
    hits = np.bincount(labels[seed[window]], minlength=2)
    hits[0] = 0
    kept = np.zeros(int(labels.max()) + 1, np.bool_)
    kept[: len(hits)] = (hits >= max(3, _PART_SHARE * hits.max()))[: len(kept)]
    mask[window] = kept[labels]
    return mask


def described(scene: Scene, mask: Mask, trunk_share: float) -> Described:
    """Describe the cells of a mask (h, w), which must not be empty."""
    window = window_of(mask)
    part, disparity = mask[window], scene.disparity[window]
    top, left = window[0].start, window[1].start
    trunk = part[: max(1, round(trunk_share * len(part)))]
    d = float(np.median(disparity[: len(trunk)][trunk].astype(np.float64)))
    rows = np.flatnonzero(trunk.any(axis=1))
    width = part.shape[1]
    first = trunk[rows].argmax(axis=1) + left
    last = width - 1 - trunk[rows, ::-1].argmax(axis=1) + left
    middle = trunk[rows] @ np.arange(width) / trunk[rows].sum(axis=1) + left
    # Left of a column the right camera sees nothing at this depth.
    unseen = int(d / scene.reduction) + 2
    return Described(
        numbers=(d, float(np.median(first)), float(np.median(middle)), float(np.median(last))),
        evidence=np.bincount(scene.evidence[window][part], minlength=4),
        border=_border(scene, mask, d),
        cut=(
            _cut(scene, rows + top, first - _BESIDE_CELLS, d, unseen),
            _cut(scene, rows + top, last + _BESIDE_CELLS, d, 0),
        ),
    )


def _border(scene: Scene, mask: Mask, disparity: float) -> tuple[int, int, int]:
    wide = window_of(mask, _RING_CELLS)
    part, d = mask[wide].astype(np.uint8), scene.disparity[wide]
    rim = cv2.dilate(part, np.ones((2 * _RIM_CELLS + 1,) * 2, np.uint8))
    around = np.ones((2 * _RING_CELLS + 1,) * 2, np.uint8)
    ring = (cv2.dilate(part, around) > 0) & (rim == 0)
    beside = cv2.dilate(np.where(part > 0, d, np.float32(0)), around)
    limit = np.float32(max(scene.least_step, scene.tolerance(disparity) / 2))
    step = beside - d
    farther = np.count_nonzero(ring & (step > limit))
    same = np.count_nonzero(ring & scene.standing[wide] & (np.abs(step) <= limit))
    return int(farther), int(same), int(np.count_nonzero(ring))


def _cut(
    scene: Scene,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    disparity: float,
    border: int,
) -> bool:
    width = scene.disparity.shape[1]
    outside = (columns < border) | (columns >= width - 1)
    inside = np.clip(columns, 0, width - 1)
    beside, tolerance = scene.disparity[rows, inside], scene.tolerance(disparity)
    nearer = beside > disparity + tolerance
    goes_on = scene.standing[rows, inside] & (beside > disparity - tolerance / 2)
    goes_on &= scene.evidence[rows, inside] == ARRIVED
    return bool((outside | nearer | goes_on).mean() > _CUT_SHARE)
