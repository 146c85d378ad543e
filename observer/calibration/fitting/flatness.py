"""Estimate of the board's bend: paper that is taped to cardboard bends by millimetres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.calibration.boards.board import Board
from observer.calibration.fitting.adjustment import POSE, Corners, StereoModel, derivatives
from observer.geometry import Float64Array

# How a board bends: about its vertical axis, about its horizontal axis, and twisted.
BEND_SHAPES = 3
# More views add no information and take much memory.
_MOST_VIEWS = 40


@dataclass(frozen=True)
class Bend:
    """Deviation of the board from a plane.

    Attributes:
        height_m: from its lowest to its highest corner, if it bends like a part of a cylinder, a
            saddle or a twist.
        sigma_m: one standard deviation of that.
    """

    height_m: float
    sigma_m: float


def board_bend(
    model: StereoModel, corners: tuple[Corners, Corners], board: Board, scatter_px: float
) -> Bend | None:
    """Return the bend that best explains the fit's residuals, with all other parameters free.

    One step of least squares from a fit that assumed a flat board; None where the views do not
    determine it.

    Args:
        scatter_px: of the fit, see ``Adjusted``.
    """
    blocks, left_over = [], []
    all_views = np.union1d(corners[0].view, corners[1].view)
    chosen = np.zeros(len(model.board_R), np.bool_)
    chosen[all_views[:: -(-len(all_views) // _MOST_VIEWS)]] = True
    views, number = int(chosen.sum()), np.cumsum(chosen) - 1
    count = model.global_count
    for camera, whole in enumerate(corners):
        seen = whole.of_views(chosen)
        residual, by_pose, by_global = derivatives(model, camera, seen)
        J = np.zeros((len(residual), 2, BEND_SHAPES + count + POSE * views))
        by_shift = by_pose[:, :, 3:]
        out_of_board = np.einsum("nij,nj->ni", by_shift, model.board_R[seen.view][:, :, 2])
        J[:, :, :BEND_SHAPES] = (
            out_of_board[:, :, None] * bend_shapes(seen.on_board, board)[:, None]
        )
        J[:, :, BEND_SHAPES : BEND_SHAPES + count] = by_global
        column = BEND_SHAPES + count + POSE * number[seen.view][:, None] + np.arange(POSE)
        np.put_along_axis(J, column[:, None].repeat(2, axis=1), by_pose, axis=2)
        blocks.append(J.reshape(-1, J.shape[2]))
        left_over.append(residual.reshape(-1))
    J, r = np.concatenate(blocks), np.concatenate(left_over)
    used = np.linalg.norm(J, axis=0)
    if not (used[:BEND_SHAPES] > 0).all() or not np.isfinite(r).all():
        return None
    J, used = J[:, used > 0], used[used > 0]
    inverse = np.linalg.pinv((J / used).T @ (J / used), hermitian=True)
    bend = (inverse @ ((J / used).T @ r) / used)[:BEND_SHAPES]
    cov = scatter_px**2 * (inverse / np.outer(used, used))[:BEND_SHAPES, :BEND_SHAPES]
    shapes = bend_shapes(board.object_points, board)
    height = shapes @ bend
    ends = shapes[int(height.argmax())] - shapes[int(height.argmin())]
    return Bend(float(ends @ bend), float(np.sqrt(ends @ cov @ ends)))


def bend_shapes(on_board: Float64Array, board: Board) -> Float64Array:
    """(N, 3) heights of the three bends at points (N, 3) of the board; 1 at its edges."""
    far = board.object_points[-1, :2]
    x, y = (2 * on_board[:, :2] / far - 1).T
    return np.stack([x * x, y * y, x * y], axis=1)
