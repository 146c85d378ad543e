"""Sub-pixel detection of a board's corners, always numbered the same way.

OpenCV's ``findChessboardCorners`` finds the chessboard and ``cornerSubPix`` refines its corners.
``findChessboardCornersSB`` finds some boards that the former misses, but places corners about half
as accurately in noisy images, so its corners are refined like all others.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import (
    CHARUCO_DICTIONARY,
    FEWEST_CORNERS,
    MARKER_SHARE,
    Board,
    BoardSighting,
)
from observer.calibration.boards.corners import goes_on, refined_corners
from observer.camera import as_gray
from observer.geometry import Float64Array
from observer.types import Image

# A live view is searched at this width first, where most boards are found in 3 ms, and at
# twice that if need be.
_QUICK_WIDTH = 320
# A file is searched enlarged too if it is no larger than this, for boards far away.
_ENLARGED_WIDTH = 1300
_THOROUGH = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
_SECTORS = cv2.CALIB_CB_EXHAUSTIVE + cv2.CALIB_CB_NORMALIZE_IMAGE


def detect_board(image: Image, board: Board, *, quick: bool = False) -> BoardSighting | None:
    """Return the corners of the board in an image, or None where it is not visible.

    A chessboard must be seen whole; of a ChArUco board ``FEWEST_CORNERS`` are enough. Corner 0
    is the one at a black square in the board's own upper left, so that a chessboard with an odd
    and an even count of inner corners is numbered the same however it is held; for others see
    ``turns_alike``.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        quick: for a live view: about 4 ms where there is a board and 20 ms at most, instead of
            trying everything (0.1 to 1 s where there is no board).
    """
    gray = as_gray(image)
    if board.kind == "charuco":
        return _detect_charuco(gray, board, quick)
    ids = np.arange(board.corner_count, dtype=np.int32)
    for found in _searches(gray, board, quick):
        if found is None or not refined_corners(gray, board, ids, found).all():
            continue
        # If the board has more corners than asked for, it is chance which of them were found.
        return None if goes_on(gray, board, found) else _numbered(gray, board, found)
    return None


def size_shown(image: Image) -> tuple[int, int] | None:
    """Columns and rows of the inner corners of a chessboard in an image, or None.

    For reporting a wrongly entered board size: it tries sizes up to 12x9 and takes a second.
    """
    gray = as_gray(image)
    for columns in range(12, 3, -1):
        for rows in range(min(columns, 9), 2, -1):
            if detect_board(gray, Board("chessboard", columns, rows), quick=True) is not None:
                return columns, rows
    return None


def turns_alike(board: Board) -> bool:
    """Return whether a board looks the same after half a turn, and so has two numberings.

    True for a chessboard with columns and rows both odd or both even in count. Such a board must be
    held upright, and both cameras must see it the same way up; see ``same_numbering``.
    """
    return board.kind == "chessboard" and (board.columns + board.rows) % 2 == 0


def same_numbering(left: BoardSighting, right: BoardSighting, board: Board) -> BoardSighting:
    """Return the right camera's corners, numbered as the left camera's.

    If the board ``turns_alike``, rows and columns are made to run the same way in both images.
    Any other board is numbered by its own colours or markers and is left as it is, even if one
    camera hangs upside down.
    """
    if not turns_alike(board) or len(left) != board.corner_count or len(right) != len(left):
        return right
    wanted = _directions(left.px, board)
    choices = [right.px[order] for order in _turns(board)]
    agreement = [float((_directions(px, board) * wanted).sum()) for px in choices]
    return BoardSighting(right.ids, np.ascontiguousarray(choices[int(np.argmax(agreement))]))


def _searches(gray: Image, board: Board, quick: bool) -> Iterator[Float64Array | None]:
    """Yield corners in any order and to a pixel, (columns * rows, 2), one search after another."""
    width = gray.shape[1]
    if quick:
        # Adaptive thresholds find little more and take 5 times as long where there is no
        # board, or only a part of one.
        for shown in (_QUICK_WIDTH, 2 * _QUICK_WIDTH):
            yield _chessboard(gray, board, min(1.0, shown / width), 0)
        return
    yield _chessboard(gray, board, 1.0, _THOROUGH)
    for shown in (640, _QUICK_WIDTH):
        if shown < width:
            yield _chessboard(gray, board, shown / width, _THOROUGH)
    yield _chessboard(gray, board, 1.0, _SECTORS)
    if width <= _ENLARGED_WIDTH:
        yield _chessboard(gray, board, 2.0, cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_FAST_CHECK)
    if width > 640:
        yield _chessboard(gray, board, 640 / width, _SECTORS)


def _chessboard(gray: Image, board: Board, scale: float, flags: int) -> Float64Array | None:
    find = cv2.findChessboardCornersSB if flags == _SECTORS else cv2.findChessboardCorners
    found, px = find(_scaled(gray, scale), (board.columns, board.rows), flags=flags)
    return _at_full_size(px, scale) if found else None


def _scaled(gray: Image, scale: float) -> Image:
    if scale == 1:
        return gray
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    size = round(gray.shape[1] * scale), round(gray.shape[0] * scale)
    return np.asarray(cv2.resize(gray, size, interpolation=way), np.uint8)


def _at_full_size(px: NDArray[Any], scale: float) -> Float64Array:
    # Scaling keeps the image's outer edge, half a pixel before the first pixel's centre.
    return (px.reshape(-1, 2).astype(np.float64) + 0.5) / scale - 0.5


def _numbered(gray: Image, board: Board, px: Float64Array) -> BoardSighting:
    """Return the corners by number: the board seen from its front, a black square at upper left."""
    grid = px.reshape(board.rows, board.columns, 2)
    if np.linalg.det(_directions(px, board)) < 0:
        grid = grid[:, ::-1]
    px = np.ascontiguousarray(grid.reshape(-1, 2))
    choices = [px[order] for order in _turns(board)]
    contrast = [_black_first(gray, board, choice) for choice in choices]
    right = [px for px, value in zip(choices, contrast, strict=True) if value >= 0] or choices
    # Of numberings that colours do not distinguish, take the one that reads from left to right.
    best = max(right, key=lambda choice: float(_directions(choice, board)[0, 0]))
    return BoardSighting(np.arange(board.corner_count, dtype=np.int32), np.ascontiguousarray(best))


def _turns(board: Board) -> list[NDArray[np.intp]]:
    """The numberings of a board seen from its front, as orders of its corners."""
    numbers = np.arange(board.corner_count).reshape(board.rows, board.columns)
    quarter = 1 if board.rows == board.columns else 2
    return [np.rot90(numbers, turns).ravel() for turns in range(0, 4, quarter)]


def _directions(px: Float64Array, board: Board) -> Float64Array:
    """(2, 2): unit vectors along rows and along columns in the image."""
    grid = px.reshape(board.rows, board.columns, 2)
    along = np.array([(grid[:, -1] - grid[:, 0]).mean(0), (grid[-1] - grid[0]).mean(0)])
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True), dtype=np.float64)


def _black_first(gray: Image, board: Board, px: Float64Array) -> float:
    """Return how much darker the squares that must be black are than the others, grey levels."""
    grid = px.reshape(board.rows, board.columns, 2)
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    u, v = (np.rint(centres[..., k]).astype(np.intp) for k in (0, 1))
    values = gray[v.clip(0, gray.shape[0] - 1), u.clip(0, gray.shape[1] - 1)].astype(np.float64)
    black = np.add.outer(np.arange(board.rows - 1), np.arange(board.columns - 1)) % 2 == 0
    return float(values[~black].mean() - values[black].mean())


def charuco_board(board: Board) -> cv2.aruco.CharucoBoard:
    """Return OpenCV's board object, for detecting and for printing."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, CHARUCO_DICTIONARY))
    return cv2.aruco.CharucoBoard(
        (board.columns + 1, board.rows + 1), board.square_m, MARKER_SHARE * board.square_m, markers
    )


@lru_cache(maxsize=4)
def _charuco_detector(board: Board) -> cv2.aruco.CharucoDetector:
    """Return OpenCV's detector for one board; cached, as it draws the board to know its markers."""
    return cv2.aruco.CharucoDetector(charuco_board(board))


def _detect_charuco(gray: Image, board: Board, quick: bool) -> BoardSighting | None:
    width = gray.shape[1]
    scales = [min(1.0, 2 * _QUICK_WIDTH / width)] if quick else [1.0, *([2.0] * (width <= 1300))]
    best: BoardSighting | None = None
    for scale in scales:
        px, ids, _, _ = _charuco_detector(board).detectBoard(_scaled(gray, scale))
        if ids is None or len(ids) < FEWEST_CORNERS or len(ids) <= (len(best) if best else 0):
            continue
        order = np.argsort(ids.ravel())
        numbers = ids.ravel()[order].astype(np.int32)
        places = _at_full_size(px, scale)[order]
        good = refined_corners(gray, board, numbers, places)
        if good.sum() < FEWEST_CORNERS:
            continue
        best = BoardSighting(numbers[good], places[good])
        if len(best) == board.corner_count:
            break
    return best
