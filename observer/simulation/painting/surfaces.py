"""Painters of the room: floors, walls, ceiling, shadows."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.painting.canvas import Canvas, Float32Array, mix, smoothstep, spread

_PANEL_M = 1.0
# The accent wall is the one that the observer faces at first.
_WALL_COLOURS = {
    "front": (168.0, 158.0, 128.0),
    "left": (205.0, 215.0, 220.0),
    "right": (196.0, 206.0, 212.0),
    "back": (200.0, 210.0, 215.0),
}


def _corner_shade(canvas: Canvas, reach_m: float, depth: float) -> Float32Array:
    """Ambient occlusion towards all four edges, 1 - depth at the very edge."""
    return np.asarray(1 - depth * np.exp(-canvas.edge_distance() / reach_m), dtype=np.float32)


def _cells(canvas: Canvas, cell_m: float) -> tuple[int, int]:
    """Return even numbers of about square cells along and down the canvas."""
    w, h = canvas.size_m
    return 2 * max(1, round(w / cell_m / 2)), 2 * max(1, round(h / cell_m / 2))


def _patches(canvas: Canvas, cell_m: float, share: float | None = None) -> Float32Array:
    """Return (height, width) 0 on the share of square cells without texture, else 1.

    The share, by default the material's, holds in every block of 2 x 2 cells, and thus wherever
    the camera looks.
    """
    if share is None:
        share = canvas.material.number("share_without", 0.0)
    nx, ny = (n // 2 for n in _cells(canvas, cell_m))
    ranks = canvas.rng.permuted(np.tile(np.arange(4), (ny * nx, 1)), axis=1)
    # The remaining fraction of a cell is decided at random, block by block.
    plain = ranks < np.floor(4 * share + canvas.rng.random((ny * nx, 1)))
    blocks = plain.reshape(ny, nx, 2, 2).transpose(0, 2, 1, 3).reshape(2 * ny, 2 * nx)
    size = (canvas.width, canvas.height)
    cells = (~blocks).astype(np.float32)
    return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_NEAREST), np.float32)


def wood(canvas: Canvas) -> NDArray[np.uint8]:
    """Parquet of planks that run along the room."""
    image = canvas.filled((104, 145, 186))
    rng = canvas.rng
    tone, gap, shift = np.zeros((3, canvas.height, canvas.width), np.float32)
    step, length = max(2, canvas.px(0.16)), canvas.px(1.3)
    for left in range(0, canvas.width, step):
        right = min(left + step, canvas.width)
        top = -int(rng.integers(0, length))
        while top < canvas.height:
            rows = slice(max(top, 0), min(top + length, canvas.height))
            tone[rows, left:right] = rng.normal(0, 1)
            shift[rows, left:right] = rng.uniform(0, 50)
            gap[rows.start : rows.start + 1, left:right] = 1
            top += length
        gap[:, left : left + 1] = 1
    grain = (
        canvas.noise(0.008, 0.35) + 0.8 * canvas.noise(0.02, 0.7) + 0.5 * canvas.noise(0.004, 0.05)
    )
    # Growth rings: the phase runs across the plank, bent by slow noise, shifted per plank.
    bend = canvas.noise(0.10, 0.9)
    rings = np.sin(canvas.columns() * 160 + 2.2 * bend + shift)
    value = 11 * tone + 6 * grain + 5 * rings + 4 * canvas.cloud(0.5, 3)
    keep = _patches(canvas, 0.8)
    image += spread(value * keep, (0.75, 0.9, 1.0))
    image = mix(image, (38, 56, 78), 0.75 * gap * keep)
    return canvas.finished(image, _floor_light(canvas))


def _floor_light(canvas: Canvas) -> Float32Array:
    """Pools of light below the lamps, darker towards the walls."""
    u, v = canvas.columns(), canvas.rows()
    w, h = canvas.size_m
    pool = np.zeros((canvas.height, canvas.width), np.float32)
    for fx in (0.25, 0.75):
        for fy in (0.2, 0.6):
            d2 = (u - fx * w) ** 2 + (v - fy * h) ** 2
            pool += np.exp(-d2 / 2.2)
    return np.asarray((0.86 + 0.2 * pool) * _corner_shade(canvas, 0.25, 0.35), np.float32)


def tiles(canvas: Canvas) -> NDArray[np.uint8]:
    """Grey vinyl tiles of two tones; a share of them is plain, the others are speckled."""
    side_m = 0.6
    image = canvas.filled((150, 152, 150))
    keep = _patches(canvas, side_m)
    speckle = canvas.noise(0.012, 0.012) + 0.8 * canvas.noise(0.03, 0.03)
    tones = _patches(canvas, side_m, 0.5) * 2 - 1
    image += spread((9 * speckle + 7 * canvas.cloud(0.25, 3)) * keep + 4 * tones)
    across, down = _cells(canvas, side_m)
    joint = np.zeros((canvas.height, canvas.width), np.float32)
    joint[np.arange(down) * canvas.height // down] = 1
    joint[:, np.arange(across) * canvas.width // across] = 1
    image = mix(image, (96, 98, 98), 0.7 * joint)
    return canvas.finished(image, _floor_light(canvas))


def _plastered(canvas: Canvas, strength: float) -> Float32Array:
    keep = _patches(canvas, _PANEL_M)
    rough = canvas.noise(0.012, 0.012) + canvas.noise(0.03, 0.03) + canvas.cloud(0.25, 4)
    image = canvas.filled(_WALL_COLOURS[canvas.material.text("where", "left")])
    return image + spread(strength * rough * keep)


def painted_wall(canvas: Canvas) -> NDArray[np.uint8]:
    """Painted plaster, darker towards the floor, above a skirting board."""
    image = _plastered(canvas, 3.2)
    above = canvas.size_m[1] - canvas.rows()
    ones = np.ones((1, canvas.width), np.float32)
    edge = 1.0 / canvas.density
    # The skirting board.
    board = ones * (1 - smoothstep(above, 0.10 - edge, 0.10 + edge))
    image = mix(image, (226, 232, 236), board)
    line = ones * np.exp(-(((above - 0.105) / 0.006) ** 2))
    image = mix(image, (90, 96, 100), 0.8 * line)
    light = 0.80 + 0.22 * smoothstep(above, 0.0, 2.2)
    return canvas.finished(image, light * _corner_shade(canvas, 0.30, 0.30))


def panelled_wall(canvas: Canvas) -> NDArray[np.uint8]:
    """Light panels with dark joints and a skirting board; a share of the panels is plain."""
    image = _plastered(canvas, 6.0)
    across, _ = _cells(canvas, _PANEL_M)
    starts = np.arange(across) * canvas.width // across
    joint = np.zeros((canvas.height, canvas.width), np.float32)
    joint[:, starts] = 1
    joint[:, starts + 1] = 1
    return _skirted(canvas, mix(image, (110, 116, 120), 0.8 * joint))


def bare_wall(canvas: Canvas) -> NDArray[np.uint8]:
    """One flat tone above a skirting board."""
    return _skirted(canvas, canvas.filled(_WALL_COLOURS[canvas.material.text("where", "left")]))


def _skirted(canvas: Canvas, image: Float32Array) -> NDArray[np.uint8]:
    """Finish a wall with a skirting board and the light of the lamps."""
    above = canvas.size_m[1] - canvas.rows()
    board = np.ones((1, canvas.width), np.float32) * (above < 0.08)
    image = mix(image, (88, 92, 96), board)
    light = 0.82 + 0.2 * smoothstep(above, 0.0, 2.2)
    return canvas.finished(image, light * _corner_shade(canvas, 0.3, 0.25))


def ceiling(canvas: Canvas) -> NDArray[np.uint8]:
    """Plain white with a corner shade."""
    return canvas.finished(canvas.filled((228, 230, 230)), _corner_shade(canvas, 0.4, 0.2))


def shadow(canvas: Canvas) -> NDArray[np.uint8]:
    """Light that a contact shadow leaves: 255 outside, dark in the middle."""
    margin = canvas.material.number("margin", 0.1)
    depth = canvas.material.number("depth", 0.62)
    image = np.zeros((canvas.height, canvas.width), np.float32)
    m = canvas.px(margin)
    image[m : canvas.height - m, m : canvas.width - m] = 1.0
    soft = cv2.GaussianBlur(image, (0, 0), margin * canvas.density * 0.33)
    # The very edge must have no effect at all, or the facet's outline would show.
    soft = soft * smoothstep(canvas.edge_distance(), 0.0, margin * 0.6)
    light = np.clip(np.rint(255 * (1 - depth * soft)), 0, 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(light, cv2.COLOR_GRAY2BGR), np.uint8)
