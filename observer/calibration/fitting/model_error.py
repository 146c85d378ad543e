"""Change of a fit if the board is bent, or the lenses have a further distortion term.

A slightly wrong model biases all views the same way, which their scatter does not show. A richer
model reveals it: by how far one Gauss-Newton step towards that model moves the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.calibration.boards.board import Board
from observer.calibration.fitting.adjustment import Corners, StereoModel, reduced_by_view
from observer.calibration.fitting.flatness import BEND_SHAPES, bend_shapes
from observer.geometry import Float64Array

# Priors, one standard deviation: of a bend, as a share of the board's longer side, and of a
# distortion coefficient of the sixth power or higher.
_BEND_SHARE = 0.0015
_COEFFICIENT = 0.1


def model_shift(
    model: StereoModel, corners: Sequence[Corners], board: Board, soft_px: float, scatter_px: float
) -> Float64Array:
    """Return the change (G,) of the global parameters towards the richer model.

    Args:
        model: that fits the corners best. corners, soft_px: as it was fitted to, see ``adjust``.
        scatter_px: of the fit, see ``Adjusted``.
    """
    extra = _distortion_count(model)

    def further(
        model: StereoModel, camera: int, seen: Corners, by_pose: Float64Array
    ) -> Float64Array:
        by_extra = np.zeros((len(seen.px), 2, BEND_SHAPES + extra * len(model.lenses)))
        out_of_board = np.einsum("nij,nj->ni", by_pose[:, :, 3:], model.board_R[seen.view][:, :, 2])
        shapes = bend_shapes(seen.on_board, board)
        by_extra[:, :, :BEND_SHAPES] = out_of_board[:, :, None] * shapes[:, None]
        begin = BEND_SHAPES + extra * camera
        by_extra[:, :, begin : begin + extra] = _by_distortion(model, camera, seen)
        return by_extra

    S, s = reduced_by_view(model, corners, soft_px, further)
    expected = np.full(S.shape[1] - model.global_count, _COEFFICIENT)
    expected[:BEND_SHAPES] = _BEND_SHARE * max(board.size_m)
    normal = S.sum(axis=0)
    known = np.concatenate([np.zeros(model.global_count), (scatter_px / expected) ** 2])
    normal += np.diag(known)
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    step = np.linalg.solve(normal * np.outer(scale, scale), scale * s.sum(axis=0))
    return np.asarray((scale * step)[: model.global_count], dtype=np.float64)


def _distortion_count(model: StereoModel) -> int:
    """Number of terms of each lens that the fit did not estimate, plus one."""
    return len(model.free) - model.free_count + 1


def _by_distortion(model: StereoModel, camera: int, seen: Corners) -> Float64Array:
    """(N, 2, E) derivatives by the terms that the fit did not estimate and the next radial one."""
    place = (
        np.einsum("nij,nj->ni", model.board_R[seen.view], seen.on_board) + model.board_t[seen.view]
    )
    if camera == 1:
        place = place @ model.R.T + model.T
    lens = model.lenses[camera]
    _, _, by_lens = lens.project(place)
    x = place[:, :2] / place[:, 2:]
    r = np.linalg.norm(x, axis=1)
    # The next powers: r r^8 after k3 of the one model, theta theta^10 after k4 of the other.
    radius = np.arctan(r) ** 11 if lens.model == "equidistant" else r**9
    focal = lens.values[:2]
    beyond = focal * x * (radius / np.maximum(r, 1e-12))[:, None]
    return np.concatenate([by_lens[:, :, ~model.free], beyond[:, :, None]], axis=2)
