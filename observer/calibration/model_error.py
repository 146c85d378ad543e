"""Change of a fit if the board is bent, or the lenses have a further distortion term.

A slightly wrong model biases all views the same way, which their scatter does not show. A richer
model reveals it: by how far one Gauss-Newton step towards that model moves the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from observer.calibration.adjustment import Corners, StereoModel, reduced_by_view
from observer.calibration.board import Board
from observer.calibration.flatness import BEND_SHAPES, bend_shapes
from observer.geometry import Float64Array

# Priors, one standard deviation: of a bend, as a share of the board's longer side, and of a
# distortion coefficient of the sixth power or higher.
_BEND_SHARE = 0.0015
_COEFFICIENT = 0.1


def model_shift(
    rig: StereoModel, corners: Sequence[Corners], board: Board, soft_px: float, scatter_px: float
) -> Float64Array:
    """Return the change (G,) of the global parameters towards the richer model.

    Args:
        rig: that fits the corners best. corners, soft_px: as it was fitted to, see ``adjust``.
        scatter_px: of the fit, see ``Adjusted``.
    """
    extra = _distortion_count(rig)

    def further(
        rig: StereoModel, camera: int, seen: Corners, by_pose: Float64Array
    ) -> Float64Array:
        by_extra = np.zeros((len(seen.px), 2, BEND_SHAPES + extra * len(rig.lenses)))
        out_of_board = np.einsum("nij,nj->ni", by_pose[:, :, 3:], rig.board_R[seen.view][:, :, 2])
        shapes = bend_shapes(seen.on_board, board)
        by_extra[:, :, :BEND_SHAPES] = out_of_board[:, :, None] * shapes[:, None]
        begin = BEND_SHAPES + extra * camera
        by_extra[:, :, begin : begin + extra] = _by_distortion(rig, camera, seen)
        return by_extra

    S, s = reduced_by_view(rig, corners, soft_px, further)
    expected = np.full(S.shape[1] - rig.global_count, _COEFFICIENT)
    expected[:BEND_SHAPES] = _BEND_SHARE * max(board.size_m)
    normal = S.sum(axis=0)
    known = np.concatenate([np.zeros(rig.global_count), (scatter_px / expected) ** 2])
    normal += np.diag(known)
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    step = np.linalg.solve(normal * np.outer(scale, scale), scale * s.sum(axis=0))
    return np.asarray((scale * step)[: rig.global_count], dtype=np.float64)


def _distortion_count(rig: StereoModel) -> int:
    """Number of terms of each lens that the fit did not estimate, plus one."""
    return len(rig.free) - rig.free_count + 1


def _by_distortion(rig: StereoModel, camera: int, seen: Corners) -> Float64Array:
    """(N, 2, E) derivatives by the terms that the fit did not estimate and the next radial one."""
    place = np.einsum("nij,nj->ni", rig.board_R[seen.view], seen.on_board) + rig.board_t[seen.view]
    if camera == 1:
        place = place @ rig.R.T + rig.T
    lens = rig.lenses[camera]
    _, _, by_lens = lens.project(place)
    x = place[:, :2] / place[:, 2:]
    r = np.linalg.norm(x, axis=1)
    # The next powers: r r^8 after k3 of the one model, theta theta^10 after k4 of the other.
    radius = np.arctan(r) ** 11 if lens.model == "equidistant" else r**9
    focal = lens.values[:2]
    beyond = focal * x * (radius / np.maximum(r, 1e-12))[:, None]
    return np.concatenate([by_lens[:, :, ~rig.free], beyond[:, :, None]], axis=2)
