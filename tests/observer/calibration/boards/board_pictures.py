"""Images of a chessboard as taken by a pair of ideal cameras."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from observer.calibration.boards.board import Board
from observer.camera import StereoCalibration
from observer.types import Image

from ..board_views import pose

# Pixels of the drawn board per square, and squares of white margin.
_SCALE, _MARGIN = 40, 1
IDEAL = StereoCalibration.rectified(640, 480, 520.0, 520.0, 319.5, 239.5, 0.1)


def drawn(board: Board) -> Image:
    """The board seen from above, with its margin."""
    columns, rows = board.columns + 1 + 2 * _MARGIN, board.rows + 1 + 2 * _MARGIN
    v, u = np.mgrid[0:rows, 0:columns]
    inside = (u >= _MARGIN) & (u < columns - _MARGIN) & (v >= _MARGIN) & (v < rows - _MARGIN)
    black = inside & ((u + v) % 2 == 0)
    squares = np.where(black, 20, 235).astype(np.uint8)
    return np.kron(squares, np.ones((_SCALE, _SCALE), np.uint8))


def pictures(board: Board, seed: int, true: StereoCalibration = IDEAL) -> tuple[Image, Image]:
    """Left and right images of the board in one pose in front of a grey wall, with noise."""
    rng = np.random.default_rng(seed)
    above = drawn(board)
    # From pixels of the drawing to metres on the board; corner 0 is its first inner corner.
    step = board.square_m / _SCALE
    first = (_MARGIN + 1) * board.square_m - step / 2
    to_board = np.array([[step, 0, -first], [0, step, -first], [0, 0, 1]])
    while True:
        R, t = pose(true, rng, tilt_deg=30)
        out = []
        for K, shift in ((true.K1, np.zeros(3)), (true.K2, true.T)):
            H = K @ np.column_stack([R[:, 0], R[:, 1], t + shift]) @ to_board
            ends = np.array([[0, 0], [above.shape[1], 0], [above.shape[1], above.shape[0]],
                             [0, above.shape[0]]], np.float64)  # fmt: skip
            px = cv2.perspectiveTransform(ends.reshape(-1, 1, 2), H).reshape(-1, 2)
            if (px < 4).any() or (px > [635, 475]).any():
                break
            # Rendered twice as large and then shrunk, so that edges are placed correctly.
            large = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
            image = cv2.warpPerspective(
                above, large @ H, (1280, 960), borderMode=cv2.BORDER_CONSTANT, borderValue=128
            )
            small = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA).astype(np.float64)
            noisy = small + rng.normal(0, 2, small.shape)
            out.append(np.clip(noisy, 0, 255).astype(np.uint8))
        if len(out) == 2:
            return out[0], out[1]


def write_pairs(folder: Path, board: Board, count: int) -> None:
    """left01.png, right01.png, ... in a folder."""
    for number in range(1, count + 1):
        for side, image in zip(("left", "right"), pictures(board, number), strict=True):
            cv2.imwrite(str(folder / f"{side}{number:02d}.png"), image)
