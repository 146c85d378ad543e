"""Sub-pixel corners of a board, each checked against all others of its board."""

from __future__ import annotations

from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import Board
from observer.geometry import Float64Array
from observer.types import Image

# Share of the distance to the nearest neighbour: the refinement's window around a corner. On a
# chessboard a larger one would reach the next corner and a smaller one has more noise; on a ChArUco
# board the markers begin at an eighth of a square.
_WINDOW_SHARE = {"chessboard": 0.4, "charuco": 0.12}
_WINDOW_PX = (2, 11)
# Share of the window: noise is smoothed first, by a Gaussian that does not move the saddle. It
# reduces a corner's error by a third. On a ChArUco board it would blur markers into the corners.
_SMOOTHING_SHARE = {"chessboard": 0.12, "charuco": 0.0}
_MOST_SMOOTHING_PX = 1.4
_PRECISION = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
# A corner is misplaced if its distance from where the others predict it is more than this many
# times the median on its board, within these bounds: at least so many pixels, at most a share of
# the distance to its neighbours. Lenses and perspective bend a board less than that.
_TOLERANCE_USUAL = 16.0
_TOLERANCE_PX = 1.5
_TOLERANCE_SHARE = 0.2
# Share of all corners: if more are misplaced, the others are unreliable too.
_MISPLACED_SHARE = 0.1
# A polynomial surface of this degree fits a tilted board through a wide-angle lens.
_DEGREE = 3


def refined_corners(
    gray: Image, board: Board, ids: NDArray[np.int32], px: Float64Array
) -> NDArray[np.bool_]:
    """Move corners to the saddle points nearest to them; return which are in their place.

    A corner that landed on something else (a highlight, a marker, a finger) is searched for again
    where the others predict it. On a chessboard half hidden by a highlight, corners would otherwise
    be wrong by a square.

    Args:
        gray: (H, W) uint8.
        ids: (N,) numbers of the corners.
        px: (N, 2) pixels, accurate to about a pixel; moved in place.

    Returns:
        (N,) True where the corner is in its place; all False if too many are not.
    """
    spacing = _spacing(board, ids, px)
    share, smoothing = _WINDOW_SHARE[board.kind], _SMOOTHING_SHARE[board.kind]
    px[:] = _saddle_points(gray, px, share * spacing, smoothing)
    misplaced, expected, tolerance = _misplaced(board, ids, px, spacing)
    if misplaced.sum() > np.ceil(_MISPLACED_SHARE * len(px)):
        return np.zeros(len(px), np.bool_)
    if misplaced.any():
        again = _saddle_points(gray, expected[misplaced], share * spacing[misplaced], smoothing)
        px[misplaced] = again
        return np.asarray(np.linalg.norm(px - expected, axis=1) <= tolerance) | ~misplaced
    return ~misplaced


def _saddle_points(
    gray: Image, px: Float64Array, reach: Float64Array, smoothing: float
) -> Float64Array:
    """Saddle points nearest to ``px`` (N, 2), within ``reach`` (N,) pixels each.

    Args:
        smoothing: standard deviation of the Gaussian applied first, as a share of the window.
    """
    windows = np.clip(reach, *_WINDOW_PX).astype(int)
    moved = px.copy()
    inside = ((px >= 0) & (px <= np.array(gray.shape[::-1]) - 1)).all(axis=1)
    for window in np.unique(windows):
        chosen = (windows == window) & inside
        if not chosen.any():
            continue
        sigma = min(_MOST_SMOOTHING_PX, smoothing * float(window))
        smooth = cv2.GaussianBlur(gray, (0, 0), sigma) if sigma > 0 else gray
        start = px[chosen].astype(np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(smooth, start, (int(window), int(window)), (-1, -1), _PRECISION)
        moved[chosen] = found.reshape(-1, 2)
    return moved


def goes_on(gray: Image, board: Board, px: Float64Array) -> bool:
    """Return whether a chessboard has more corners than those found: ``px`` (columns * rows, 2).

    OpenCV finds 8x6 corners in a board of 9x6, different ones in each image. Beyond the last corner
    of a row, white and black still alternate on two sides; only within a board do they on all four.
    """
    grid = px.reshape(board.rows, board.columns, 2)
    across, down = (np.asarray(np.gradient(grid, axis=axis)) for axis in (1, 0))
    contrast = np.median(_saddle_contrast(gray, grid, across, down))
    for way in (grid, grid[::-1], grid.swapaxes(0, 1), grid.swapaxes(0, 1)[::-1]):
        # Perspective makes the steps grow; quadratic extrapolation continues that.
        beyond = 3 * way[0] - 3 * way[1] + way[2]
        seen = _saddle_contrast(gray, beyond, np.gradient(beyond, axis=0), beyond - way[0])
        seen = seen[np.isfinite(seen)]
        if len(seen) > 1 and np.mean(seen > 0.75 * contrast) > 0.6:
            return True
    return False


def _saddle_contrast(
    gray: Image, px: Float64Array, along: Float64Array, across: Float64Array
) -> Float64Array:
    """Return the contrast between both pairs of opposite squares at a corner; NaN outside."""
    value = np.zeros(px.shape[:-1])
    for a, b in product((1, -1), repeat=2):
        place = np.rint(px + 0.35 * (a * along + b * across))
        inside = ((place >= 0) & (place < gray.shape[::-1])).all(axis=-1)
        u, v = (place[..., k].clip(0, gray.shape[1 - k] - 1).astype(np.intp) for k in (0, 1))
        value += np.where(inside, a * b * gray[v, u].astype(np.float64), np.nan)
    return np.abs(value)


def _spacing(board: Board, ids: NDArray[np.int32], px: Float64Array) -> Float64Array:
    """(N,) distance to the nearest neighbour along a row or column, pixels; 0 without one."""
    grid = np.full((board.rows + 2, board.columns + 2, 2), np.nan)
    row, column = ids // board.columns + 1, ids % board.columns + 1
    grid[row, column] = px
    steps = [
        np.linalg.norm(grid[row + dv, column + du] - px, axis=1)
        for du, dv in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    nearest = np.nan_to_num(np.array(steps), nan=np.inf).min(axis=0)
    return np.where(np.isfinite(nearest), nearest, 0.0)


def _misplaced(
    board: Board, ids: NDArray[np.int32], px: Float64Array, spacing: Float64Array
) -> tuple[NDArray[np.bool_], Float64Array, Float64Array]:
    """Return the outliers of a smooth surface through the others, expected places and tolerances.

    The worst ones are left out one by one. The distance of each from the surface through all but
    itself follows from its residual and leverage, e / (1 - h).
    """
    terms = _terms(board, ids)
    kept = np.ones(len(px), np.bool_)
    tolerance = np.zeros(len(px))
    for _ in range(int(np.ceil(_MISPLACED_SHARE * len(px))) + 1):
        solve = np.linalg.pinv(terms[kept])
        expected = terms @ (solve @ px[kept])
        unseen = 1 - np.einsum("ij,ji->i", terms[kept], solve)
        distance = np.linalg.norm(px - expected, axis=1)[kept]
        usual = np.full(len(px), _TOLERANCE_USUAL * np.median(distance))
        tolerance = np.clip(
            usual, _TOLERANCE_PX, np.maximum(_TOLERANCE_PX, _TOLERANCE_SHARE * spacing)
        )
        # A corner that the surface follows wherever it is (leverage near 1) cannot be checked.
        excess = np.where(unseen > 0.05, distance / np.maximum(unseen, 0.05), 0) / tolerance[kept]
        if excess.max() <= 1:
            break
        kept[np.flatnonzero(kept)[int(np.argmax(excess))]] = False
    return ~kept, np.asarray(expected, dtype=np.float64), tolerance


def _terms(board: Board, ids: NDArray[np.int32]) -> Float64Array:
    """(N, terms): powers of column and row, as high as the corners in view can determine."""
    row, column = ids // board.columns, ids % board.columns
    degrees = [min(_DEGREE, max(1, len(np.unique(axis)) - 2)) for axis in (column, row)]
    u, v = 2 * column / (board.columns - 1) - 1, 2 * row / (board.rows - 1) - 1
    powers = product(range(degrees[0] + 1), range(degrees[1] + 1))
    return np.stack([u**a * v**b for a, b in powers if a + b <= _DEGREE], axis=1)
