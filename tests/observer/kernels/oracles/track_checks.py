"""Oracle of ``observer.kernels.track_checks``: all points at once, by numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Flow:
    """Lucas-Kanade's result for N points: (N, 2) px, (N,) status, 0 if lost, (N,) quality."""

    px: Singles
    status: NDArray[np.uint8]
    quality: Singles

    @property
    def found(self) -> Flags:
        return np.asarray(self.status > 0)

    @property
    def known_quality(self) -> Singles:
        """Quality, 0 for lost points."""
        return np.where(self.found, self.quality, np.float32(0))


def returned(
    start: Singles,
    there: Flow,
    back: Flow,
    size: tuple[int, int],
    margin: float,
    unit: float,
    back_px: float,
    max_error: float,
) -> tuple[Flags, Singles, Singles]:
    """(N,) which points passed, (N,) difference in grey levels, (N,) texture in grey levels/px."""
    difference = there.known_quality
    texture = np.sqrt(np.maximum(back.known_quality, 0) * np.float32(unit))
    found = there.found & back.found & inside(there.px, size, margin)
    found &= ((back.px - start) ** 2).sum(axis=1) <= back_px**2
    found &= difference <= max_error
    return np.asarray(found), difference, texture


def on_the_row(
    px: Singles,
    expected_disparity: Singles,
    flow: Flow,
    size: tuple[int, int],
    row_px: float,
    max_error: float,
) -> tuple[Singles, Singles]:
    """(N, 2) pixels in the right image, NaN without a match, and (N,) difference in grey levels."""
    difference = flow.known_quality
    good = np.isfinite(expected_disparity) & flow.found & (difference <= max_error)
    good &= np.abs(flow.px[:, 1] - px[:, 1]) <= row_px
    good &= inside(flow.px, size, 0.0)
    return np.where(good[:, None], flow.px, np.float32(np.nan)), difference


def around_the_circle(
    difference: Singles,
    texture: Singles,
    at: NDArray[np.intp],
    matched: Singles,
    mismatch: Singles,
    circle: NDArray[np.intp],
    around: Flow,
    circle_px: float,
    side: int,
    least_texture: float,
    deviation: float,
    factor: float,
    floor: float,
) -> tuple[Singles, Singles]:
    """(N, 2) pixels in the right image, and (N, 2) standard deviations in both images."""
    right = np.full((len(difference), 2), np.nan, np.float32)
    unlike = np.zeros(len(difference), np.float32)
    right[at], unlike[at] = matched, mismatch
    apart = ((around.px - matched[circle]) ** 2).sum(axis=1) > circle_px**2
    right[at[circle[apart | ~around.found]]] = np.nan
    both = np.stack([difference, unlike], axis=1)
    slope = np.maximum(side * texture, least_texture)[:, None]
    return right, np.hypot(factor * (deviation * both / slope), floor).astype(np.float32)


def inside(px: Singles, size: tuple[int, int], margin: float) -> Flags:
    """(N,) which points (N, 2) px are at least ``margin`` from the edges of (height, width)."""
    limits = (size[1] - 1 - margin, size[0] - 1 - margin)
    return np.asarray(((px >= margin) & (px <= limits)).all(axis=1), np.bool_)
