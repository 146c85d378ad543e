"""Pictures of one person before a wall, moved by any number of cells."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.dense.segments import segment_of

from .solid_worlds import GRID, ROOM, Solid, cells_of, seen

Image = NDArray[np.uint8]
PERSON = Solid((0.0, 0.0, 3.0), (0.5, 1.2, 0.1))
HERE = segment_of(seen([*ROOM, PERSON]), cells_of(PERSON, [*ROOM, PERSON]))
LEFT, TOP, RIGHT, BOTTOM = HERE.box
FINE = 8
NOISE = 1.5


def textured(seed: int, shape: tuple[int, int], levels: float) -> Float64Array:
    """(h, w) smooth enough for bilinear interpolation."""
    grain = np.random.default_rng(seed).normal(0.0, 1.0, shape)
    smooth = cv2.GaussianBlur(grain, (0, 0), 1.2 * FINE)
    return np.asarray(128 + levels * smooth / smooth.std())


def picture(
    shift: tuple[float, float] = (0.0, 0.0),
    *,
    clothes: float = 20.0,
    tone: float = 40.0,
    wall: float = 0.0,
    light: float = 0.0,
    arm: float = 0.0,
    seed: int = 0,
) -> Image:
    """The left image with the person moved by cells; drawn finely, then reduced.

    Args:
        clothes, wall: contrast of their texture, grey levels. tone: of the clothes above the
            wall's. light: grey levels added. arm: cells by which an arm in front of it moved.
    """
    h, w = GRID.shape
    image = (
        textured(1, (h * FINE, w * FINE), wall) if wall else np.full((h * FINE, w * FINE), 128.0)
    )
    body = textured(2, image.shape, clothes) if clothes else np.full(image.shape, 128.0)
    mask = np.zeros(image.shape, np.uint8)
    mask[TOP * FINE : BOTTOM * FINE, LEFT * FINE : RIGHT * FINE] = 1
    move = np.array([[1.0, 0.0, shift[0] * FINE], [0.0, 1.0, shift[1] * FINE]])
    size = (image.shape[1], image.shape[0])
    moved, where = (cv2.warpAffine(a, move, size) for a in (body + tone, mask))
    image = np.where(where > 0, moved, image)
    if arm:
        u = int((LEFT + 4 + arm) * FINE)
        image[(TOP + 6) * FINE : BOTTOM * FINE, u : u + 3 * FINE] = 60.0
    small = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA) + light
    noise = np.random.default_rng(seed).normal(0.0, NOISE, small.shape)
    return np.clip(np.rint(small + noise), 0, 255).astype(np.uint8)
