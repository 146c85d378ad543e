"""Corrections of dense disparities: the pair's bias, and motion until the right camera exposes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.kernels import corrections
from observer.methods.rigid.dense.grid import Grid
from observer.vision.camera_rate import CameraRate


def with_bias(disparity: NDArray[np.float32], bias_px: float, grid: Grid) -> NDArray[np.float32]:
    """(h, w) px: disparities plus a bias, which is given for the image's centre."""
    if not bias_px:
        return disparity
    c = grid.camera
    lens = (c.fx, c.fy, c.cx, c.cy, c.baseline)
    return corrections.with_bias(disparity, bias_px, lens, grid.reduction)


def at_one_time(
    disparity: NDArray[np.float32], rate: CameraRate, delay_s: float, grid: Grid
) -> NDArray[np.float32]:
    """(h, w) px: disparities of static things, as if both cameras had exposed at one time.

    A static point's column changes by ``f ((X' - x Z') / Z)`` per second, with
    ``(X', Y', Z') = turn x (X, Y, Z) + shift``.

    Args:
        rate: the camera's. delay_s: seconds from the left exposure to the right one.
    """
    if not delay_s:
        return disparity
    height, width = grid.shape
    rays = grid.rays
    x = (rays[0, 0] * np.arange(width) + rays[0, 2]).astype(np.float32)
    y = (rays[1, 1] * np.arange(height) + rays[1, 2]).astype(np.float32)[:, None]
    camera = grid.camera
    (turn_x, turn_y, turn_z), (shift_x, _, shift_z) = (
        a.astype(np.float32) * np.float32(camera.fx * delay_s) for a in (rate.turn, rate.shift)
    )
    nearness = disparity / np.float32(camera.fb)
    turned = turn_y * (1 + x * x) - turn_z * y - turn_x * (x * y)
    return np.asarray(disparity + turned + nearness * (shift_x - x * shift_z), np.float32)
