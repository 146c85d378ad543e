"""The last few pairs of a run, spread over time, for a refinement at a click."""

from __future__ import annotations

from collections import deque

import numpy as np

from observer.camera import as_gray
from observer.types import Image

# So many pairs, this far apart: enough to average what one scene does to the rows, and recent
# enough to show the cameras as they stand now.
_PAIRS = 8
_SPACING_S = 3.0


class ScenePairs:
    """Keeps copies in grey of the newest pairs; 8 of 640x480 are 5 MB."""

    def __init__(self, count: int = _PAIRS, spacing_s: float = _SPACING_S) -> None:
        self._kept: deque[tuple[float, Image, Image]] = deque(maxlen=count)
        self._spacing_s = spacing_s

    def offer(self, time_s: float, left: Image, right: Image) -> None:
        """One frame as taken, not rectified; it is kept if the last kept one is old enough.

        Args:
            time_s: seconds on the source's clock. left, right: (H, W) grey or (H, W, 3) BGR.
        """
        if self._kept and abs(time_s - self._kept[-1][0]) < self._spacing_s:
            return
        if self._kept and self._kept[-1][1].shape != left.shape[:2]:
            self._kept.clear()
        # A source may write the next frame into the same memory.
        self._kept.append((time_s, np.array(as_gray(left)), np.array(as_gray(right))))

    @property
    def pairs(self) -> tuple[tuple[Image, Image], ...]:
        """The kept pairs (H, W) grey, oldest first."""
        return tuple((left, right) for _, left, right in self._kept)
