"""Views of a board by an exactly known pair of cameras; noisy corners, no images."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from observer.calibration.boards.board import Board, BoardSighting, BoardView
from observer.camera import StereoCalibration
from observer.geometry import Float64Array

BOARD = Board()
WIDTH, HEIGHT = 640, 480


def true_pair(baseline: float = 0.12) -> StereoCalibration:
    """Two webcams with strong distortion, the right one tilted by 0.4, -0.6 and 0.3 degrees."""
    R = Rotation.from_euler("xyz", [0.4, -0.6, 0.3], degrees=True).as_matrix()
    return StereoCalibration(
        WIDTH,
        HEIGHT,
        np.array([[520.0, 0, 316], [0, 521, 243], [0, 0, 1]]),
        np.array([-0.28, 0.07, 0.0005, -0.0003, 0]),
        np.array([[525.0, 0, 325], [0, 525, 238], [0, 0, 1]]),
        np.array([-0.285, 0.07, -0.0002, 0.0004, 0]),
        R,
        R @ np.array([-baseline, 0, 0]),
    )


def fisheye_pair() -> StereoCalibration:
    true = true_pair()
    return replace(
        true,
        K1=np.array([[300.0, 0, 316], [0, 300, 243], [0, 0, 1]]),
        K2=np.array([[303.0, 0, 325], [0, 303, 238], [0, 0, 1]]),
        D1=np.array([-0.02, 0.004, 0.001, -0.0005]),
        D2=np.array([-0.021, 0.004, 0.001, -0.0005]),
        distortion_model="equidistant",
    )


def pose(
    true: StereoCalibration, rng: np.random.Generator, tilt_deg: float = 40
) -> tuple[Float64Array, Float64Array]:
    """T_left_board of a board that fills a third to over three quarters of the image's width."""
    tilt = rng.uniform(-tilt_deg, tilt_deg, 2)
    R = Rotation.from_euler("xyz", [*tilt, rng.uniform(-20, 20)], degrees=True).as_matrix()
    f = true.K1[0, 0]
    z = f * BOARD.size_m[0] / (rng.uniform(0.35, 0.85) * WIDTH)
    across, down = (rng.uniform(0.2, 0.8) - 0.5) * WIDTH, (rng.uniform(0.25, 0.75) - 0.5) * HEIGHT
    return R, z * np.array([across / f, down / f, 1.0]) - R @ BOARD.object_points.mean(axis=0)


def projected(
    true: StereoCalibration, R: Float64Array, t: Float64Array, bend_m: float = 0.0
) -> tuple[Float64Array, Float64Array]:
    """Pixels (54, 2) of the board's corners in both images, without noise.

    The board's left and right edges stand ``bend_m`` out of the plane of its middle.
    """
    module = cv2.fisheye if true.distortion_model == "equidistant" else cv2
    points = BOARD.object_points
    points[:, 2] = bend_m * (2 * points[:, 0] / points[-1, 0] - 1) ** 2
    left = points @ R.T + t
    right = left @ true.R.T + true.T
    zero = np.zeros(3)
    return tuple(
        module.projectPoints(p.reshape(-1, 1, 3), zero, zero, K, D)[0].reshape(-1, 2)
        for p, K, D in ((left, true.K1, true.D1), (right, true.K2, true.D2))
    )


def views_of(
    true: StereoCalibration, count: int, seed: int, noise_px: float = 0.15, bend_m: float = 0.0
) -> list[BoardView]:
    """Views in which both cameras see the whole board, named 1, 2, ..."""
    rng = np.random.default_rng(seed)
    found: list[BoardView] = []
    while len(found) < count:
        pair = projected(true, *pose(true, rng), bend_m)
        if all((px > 3).all() and (px < [WIDTH - 4, HEIGHT - 4]).all() for px in pair):
            noisy = (sighting(px + rng.normal(0, noise_px, px.shape)) for px in pair)
            found.append(BoardView(str(len(found) + 1), *noisy))
    return found


def sighting(px: Float64Array, chosen: NDArray[np.bool_] | None = None) -> BoardSighting:
    """The corners in order, or only the chosen ones."""
    ids = np.arange(len(px), dtype=np.int32)
    if chosen is None:
        return BoardSighting(ids, px)
    return BoardSighting(ids[chosen], px[chosen])
