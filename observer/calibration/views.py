"""Views of a board: by one camera, and by both at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array

# Fewer corners do not tell a board's pose and a lens apart.
FEWEST_CORNERS = 8


@dataclass(frozen=True, eq=False)
class BoardSighting:
    """The corners of a board that one image shows.

    Attributes:
        ids: (N,) int32, numbers of the corners (see ``Board``), rising.
        px: (N, 2) float64, pixels of the image as taken; the upper left pixel's centre is (0, 0).

    Raises:
        ValueError: the two differ in length, or the numbers do not rise.
    """

    ids: NDArray[np.int32]
    px: Float64Array

    def __post_init__(self) -> None:
        if self.px.shape != (len(self.ids), 2) or (np.diff(self.ids) <= 0).any():
            raise ValueError("every corner of a board needs one number and one place in the image")

    def __len__(self) -> int:
        return len(self.ids)

    def common_px(self, other: BoardSighting) -> tuple[Float64Array, Float64Array]:
        """(N, 2) pixels each, here and in the other image, of the corners that both show."""
        _, here, there = np.intersect1d(self.ids, other.ids, return_indices=True)
        return self.px[here], other.px[there]


@dataclass(frozen=True, eq=False)
class BoardView:
    """One pose of a board, as both cameras saw it at the same time.

    Attributes:
        name: what a person finds it by: a file's name or a number.
        left, right: None where this camera did not see the board.
    """

    name: str
    left: BoardSighting | None
    right: BoardSighting | None
