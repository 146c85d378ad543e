"""Boards drawn into images with exactly known corners, and cameras that see them."""

from __future__ import annotations

import cv2
import numpy as np

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.detection import charuco_board

SIZE = (640, 480)
BLACK, WHITE, WALL = 40.0, 200.0, 120.0
# Samples per pixel along each side, and pixels per side of a square in the board's drawing.
_SAMPLES, _SQUARE_PX = 3, 48


def camera_matrix(focal: float, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.array(
        [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]], dtype=float
    )


def board_to_image(
    board: Board,
    width_px: float,
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0),
    centre: tuple[float, float] = (319.5, 239.5),
    size: tuple[int, int] = SIZE,
) -> np.ndarray:
    """Homography from squares (corner 0 is (0, 0)) to pixels; inner corners span ``width_px``."""
    focal = 500.0
    turn = cv2.Rodrigues(np.array([tilt[0], tilt[1], 0.0]))[0]
    turn = turn @ cv2.Rodrigues(np.array([0.0, 0.0, tilt[2]]))[0]
    depth = focal * (board.columns - 1) / width_px
    camera = camera_matrix(focal, size)
    place = np.linalg.inv(camera) @ (*centre, 1.0) * depth
    middle = np.array([(board.columns - 1) / 2, (board.rows - 1) / 2, 0.0])
    return camera @ np.column_stack([turn[:, 0], turn[:, 1], place - turn @ middle])


def draw(
    board: Board,
    homography: np.ndarray,
    *,
    sigma: float = 3.0,
    blur: float = 0.8,
    seed: int = 0,
    size: tuple[int, int] = SIZE,
) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) uint8 image of the board with a white border of one square, and its true corners."""
    paper = np.array([[-2, -2], [board.columns + 1, -2], [-2, board.rows + 1]], dtype=float)
    paper = np.vstack([paper, paper[1] + paper[2] - paper[0]])
    there = np.column_stack([paper, np.ones(4)]) @ homography.T
    there = there[:, :2] / there[:, 2:]
    first = np.clip(np.floor(there.min(axis=0)) - 2, 0, size).astype(int)
    last = np.clip(np.ceil(there.max(axis=0)) + 3, 0, size).astype(int)
    v, u = np.mgrid[first[1] : last[1], first[0] : last[0]].astype(np.float32)
    drawing = _squares(board)
    to_board = np.linalg.inv(homography)
    total = np.full(size[::-1], WALL)
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    total[first[1] : last[1], first[0] : last[0]] = np.mean(
        [_brightness(board, drawing, to_board, u + du, v + dv) for dv in steps for du in steps],
        axis=0,
    )
    image = np.asarray(cv2.GaussianBlur(total, (0, 0), blur), np.float64)
    image += np.random.default_rng(seed).normal(0, sigma, image.shape)
    squares = board.object_points / board.square_m + (0, 0, 1)
    there = squares @ homography.T
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), there[:, :2] / there[:, 2:]


def _squares(board: Board) -> np.ndarray:
    """Drawing of the board, True where black; every edge lies on a whole number of pixels."""
    if board.kind == "charuco":
        size = (board.columns + 1) * _SQUARE_PX, (board.rows + 1) * _SQUARE_PX
        return charuco_board(board).generateImage(size) < 128
    one = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2 == 0
    return np.kron(one, np.ones((_SQUARE_PX, _SQUARE_PX))) > 0


def _brightness(
    board: Board, drawing: np.ndarray, to_board: np.ndarray, u: np.ndarray, v: np.ndarray
) -> np.ndarray:
    to_board = to_board.astype(np.float32)
    w = to_board[2, 0] * u + to_board[2, 1] * v + to_board[2, 2]
    x = (to_board[0, 0] * u + to_board[0, 1] * v + to_board[0, 2]) / w + 1
    y = (to_board[1, 0] * u + to_board[1, 1] * v + to_board[1, 2]) / w + 1
    across, down = board.columns + 1, board.rows + 1
    squares = (x > 0) & (x < across) & (y > 0) & (y < down)
    paper = (x > -1) & (x < across + 1) & (y > -1) & (y < down + 1)
    row = np.clip(y * _SQUARE_PX, 0, drawing.shape[0] - 1).astype(np.int32)
    column = np.clip(x * _SQUARE_PX, 0, drawing.shape[1] - 1).astype(np.int32)
    return np.where(squares & drawing[row, column], BLACK, np.where(paper, WHITE, WALL))


def seen_by(
    board: Board,
    turn: np.ndarray,
    place: np.ndarray,
    camera: np.ndarray,
    distortion: np.ndarray,
    rng: np.random.Generator,
    size: tuple[int, int] = SIZE,
) -> BoardSighting | None:
    """Return the detection of a board at a pose (rotation vector, metres), without an image."""
    edge = np.array(
        [[-1, -1], [board.columns, -1], [board.columns, board.rows], [-1, board.rows]], dtype=float
    )
    edge = np.column_stack([edge * board.square_m, np.zeros(4)])
    outline = cv2.projectPoints(edge, turn, place, camera, distortion)[0][:, 0]
    px = cv2.projectPoints(board.object_points, turn, place, camera, distortion)[0][:, 0]
    if board.kind == "chessboard":
        inside = np.full(len(px), ((outline >= 0) & (outline < size)).all())
    else:
        inside = np.all((px > 6) & (px < np.array(size) - 6), axis=1)
    if inside.sum() < 8:
        return None
    ids = np.flatnonzero(inside).astype(np.int32)
    return BoardSighting(ids, px[ids] + rng.normal(0, 0.05, (len(ids), 2)))
