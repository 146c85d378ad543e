"""The boards that cameras are calibrated with, and how cameras see them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from observer.errors import CalibrationError
from observer.geometry import Float64Array

BoardKind = Literal["chessboard", "charuco"]
# The markers of every ChArUco board here: 250 different ones serve boards of up to 500 squares.
CHARUCO_DICTIONARY = "DICT_4X4_250"
# Share of a square's side; detection depends on the white margin around a marker.
MARKER_SHARE = 0.75
# With fewer corners, a board's pose cannot be distinguished from the lens.
FEWEST_CORNERS = 8

# Numbers of inner corners in each direction, and the side of a square.
MIN_SIDE_CORNERS, MAX_SIDE_CORNERS = 3, 30
MIN_SQUARE_MM, MAX_SQUARE_MM = 2.0, 500.0
# A chessboard that fits on A4 with the white margin that detection needs.
A4_COLUMNS, A4_ROWS, A4_SQUARE_MM = 9, 6, 21.0


@dataclass(frozen=True)
class Board:
    """A flat board of squares, named by its inner corners as in OpenCV.

    Corner ``i`` is column ``i % columns`` of row ``i // columns``. The board's own frame lies on
    it: x along a row, y along a column, z into the board, the origin at corner 0.

    Attributes:
        kind: ``chessboard``, or ``charuco``, whose squares carry markers, so that seeing a part of
            it is enough.
        columns, rows: inner corners; there is one square more each way.
        square_m: side of a square, metres.

    Raises:
        CalibrationError: one sentence on what is wrong and what would be right.
    """

    kind: BoardKind = "chessboard"
    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def __post_init__(self) -> None:
        if self.kind not in ("chessboard", "charuco"):
            raise CalibrationError(f"a board is 'chessboard' or 'charuco', not {self.kind!r}")
        for name in ("columns", "rows"):
            value = getattr(self, name)
            if not MIN_SIDE_CORNERS <= value <= MAX_SIDE_CORNERS:
                raise CalibrationError(
                    f"a board has {MIN_SIDE_CORNERS} to {MAX_SIDE_CORNERS} inner corners in each "
                    f"direction, not {value} {name}; count the corners between squares, not the "
                    "squares"
                )
        if not MIN_SQUARE_MM / 1e3 <= self.square_m <= MAX_SQUARE_MM / 1e3:
            raise CalibrationError(
                f"the squares of a board are {MIN_SQUARE_MM:g} to {MAX_SQUARE_MM:g} mm "
                f"wide, not {1e3 * self.square_m:g} mm"
            )
        if self.kind == "charuco" and (self.columns + 1) * (self.rows + 1) > 500:
            raise CalibrationError("a ChArUco board may have at most 500 squares")

    @property
    def corner_count(self) -> int:
        return self.columns * self.rows

    @property
    def object_points(self) -> Float64Array:
        """(columns * rows, 3) metres, the corners in the board's frame, by number."""
        v, u = np.mgrid[0 : self.rows, 0 : self.columns]
        flat = np.stack([u.ravel(), v.ravel(), np.zeros(self.corner_count)], axis=1)
        return np.asarray(flat * self.square_m, dtype=np.float64)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of all squares, metres."""
        return (self.columns + 1) * self.square_m, (self.rows + 1) * self.square_m

    @property
    def words(self) -> str:
        """Name for people: ``chessboard 9x6, 25 mm``."""
        name = "ChArUco board" if self.kind == "charuco" else "chessboard"
        return f"{name} {self.columns}x{self.rows}, {1e3 * self.square_m:g} mm"


def parse_board_size(text: str) -> tuple[int, int]:
    """Columns and rows of ``9x6``.

    Raises:
        CalibrationError: the text is not of this form.
    """
    columns, x, rows = text.lower().replace("×", "x").partition("x")
    if not (x and all(re.fullmatch(r"\s*[0-9]{1,4}\s*", part) for part in (columns, rows))):
        raise CalibrationError(
            "give the board's size as COLUMNSxROWS of inner corners, for example 9x6, not "
            f"{text[:40]!r}"
        )
    return int(columns), int(rows)


@dataclass(frozen=True, eq=False)
class BoardSighting:
    """The corners of a board that one image shows.

    Attributes:
        ids: (N,) int32, numbers of the corners (see ``Board``), ascending.
        px: (N, 2) float64, pixels of the image as taken; the upper left pixel's centre is (0, 0).

    Raises:
        ValueError: the two differ in length, or the numbers do not ascend.
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
