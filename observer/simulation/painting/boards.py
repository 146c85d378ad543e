"""Calibration boards as printed: squares within a white margin of one square."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import CHARUCO_DICTIONARY, MARKER_SHARE
from observer.simulation.painting.canvas import Canvas

# Grey values of paper and ink, chosen so that noise and light do not clip at black or white.
_PAPER, _INK = 225.0, 28.0


def chessboard(canvas: Canvas) -> NDArray[np.uint8]:
    """A chessboard whose upper left square is black."""
    columns, rows, side = _squares(canvas)
    v, u = np.mgrid[0:rows, 0:columns]
    white = np.kron((u + v) % 2, np.ones((side, side)))
    return _printed(canvas, white, side)


def charuco(canvas: Canvas) -> NDArray[np.uint8]:
    """A ChArUco board in OpenCV's layout since 4.6, which its detector expects."""
    columns, rows, side = _squares(canvas)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, CHARUCO_DICTIONARY))
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, MARKER_SHARE, dictionary)
    image = board.generateImage((columns * side, rows * side), marginSize=0, borderBits=1)
    return _printed(canvas, image / 255, side)


def _squares(canvas: Canvas) -> tuple[int, int, int]:
    """Return the number of squares along and down, and the side of one in pixels."""
    columns = round(canvas.material.number("columns", 9)) + 1
    rows = round(canvas.material.number("rows", 6)) + 1
    return columns, rows, canvas.width // (columns + 2)


def _printed(canvas: Canvas, white: NDArray[np.float64], side: int) -> NDArray[np.uint8]:
    """Return (height, width, 3) of squares (h, w), 0 ink to 1 paper, with a margin around."""
    page = np.ones((canvas.height, canvas.width))
    page[side : side + white.shape[0], side : side + white.shape[1]] = white
    gray = np.rint(_INK + (_PAPER - _INK) * page).astype(np.uint8)
    return np.asarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), np.uint8)
