"""A board that moves in front of a wall, rendered as stereo pairs with known motion."""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np

from observer.camera import StereoCalibration
from observer.observer import Observer
from observer.types import Observation, StereoFrame

WIDTH, HEIGHT, F, BASELINE = 512, 256, 443.0, 0.12
CALIBRATION = StereoCalibration.rectified(WIDTH, HEIGHT, F, F, 255.5, 127.5, BASELINE)
DT = 1 / 15
WALL_M, BOARD_M = 4.0, 2.0


def _texture(seed: int, size: tuple[int, int], blur: float) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, size).astype(np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), blur), None, 10, 245, cv2.NORM_MINMAX)


_WALL = _texture(1, (900, 1800), 2.0)
_BOARD = _texture(2, (70, 100), 1.5)


def render(camera: tuple[float, float, float], board_x: float | None, eye: float) -> np.ndarray:
    """A wall at 4 m and a board at 2 m, seen by a camera at ``camera`` shifted by ``eye``, m."""
    x, y, z = camera[0] + eye, camera[1], camera[2]
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    # From the start position, one texture pixel on the wall is one image pixel.
    scale = (WALL_M - z) / WALL_M
    wall = cv2.remap(
        _WALL,
        ((u - 255.5) * scale + x * F / WALL_M + 900).astype(np.float32),
        ((v - 127.5) * scale + y * F / WALL_M + 450).astype(np.float32),
        cv2.INTER_LINEAR,
    )
    if board_x is None:
        return wall
    scale = (BOARD_M - z) / BOARD_M
    board_u = ((u - 255.5) * scale + (x - board_x) * F / BOARD_M + 50).astype(np.float32)
    board_v = ((v - 127.5) * scale + y * F / BOARD_M + 35).astype(np.float32)
    board = cv2.remap(_BOARD, board_u, board_v, cv2.INTER_LINEAR)
    on_board = (board_u >= 0) & (board_u < 99) & (board_v >= 0) & (board_v < 69)
    return np.where(on_board, board, wall)


def frames(count: int, **scene: Any) -> list[StereoFrame]:
    """Rendered frames, see ``_frames``; cached, so that each sequence is rendered only once."""
    return list(_frames(count, **scene))


@functools.cache
def _frames(
    count: int,
    *,
    board_speed: float | None = 0.4,
    camera_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    times: tuple[float, ...] | None = None,
    color: bool = False,
    seed: int = 0,
) -> tuple[StereoFrame, ...]:
    rng = np.random.default_rng(seed)
    out = []
    for k, t in enumerate(np.arange(count) * DT if times is None else times):
        camera = tuple(np.array(camera_velocity) * t)
        board = None if board_speed is None else -0.4 + board_speed * t
        images = [
            np.clip(render(camera, board, eye) + rng.normal(0, 2, (HEIGHT, WIDTH)), 0, 255)
            for eye in (0.0, BASELINE)
        ]
        left, right = (image.astype(np.uint8) for image in images)
        if color:
            left, right = (
                np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
                for image in (left, right)
            )
        out.append(StereoFrame(k, float(t), left, right, received=100.0 + t))
    return tuple(out)


def observe_all(observer: Observer, sequence: list[StereoFrame]) -> list[Observation]:
    return [observer.observe(frame) for frame in sequence]


def fixed_clock() -> float:
    return 0.0


def black(frame: StereoFrame) -> StereoFrame:
    dark = np.zeros_like(frame.left)
    return StereoFrame(frame.index, frame.time, dark, dark, frame.received)
