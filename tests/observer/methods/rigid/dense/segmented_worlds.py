"""Worlds of whose cells it is known what arrived and what was uncovered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, fresh_segments

from ..solid_worlds import ALL, GRID, HERE, ROOM, Shape, Solid, cells_of, on_floor, seen

Mask = NDArray[np.bool_]


def world(
    *things: Shape, arrived: Sequence[Shape] = (), uncovered: Sequence[Shape] = ()
) -> DenseScene:
    """A room with things, including those that arrived and those that were uncovered."""
    shapes = [*ROOM, *things, *arrived, *uncovered]
    evidence = np.full(GRID.shape, STATIC, np.uint8)
    for what, kind in ((arrived, ARRIVED), (uncovered, UNCOVERED)):
        for shape in what:
            evidence[cells_of(shape, shapes)] = kind
    bare = seen(shapes)
    evidence[~bare.standing] = 0
    return seen(shapes, HERE, evidence)


def only(scene: DenseScene) -> Segment:
    (segment,) = fresh_segments(scene, ALL)
    return segment


def ball(x: float, z: float, size: float = 0.25) -> Solid:
    return on_floor(x, z, (size, size, size))


def window_mask(top: int, bottom: int, left: int, right: int) -> Mask:
    mask = np.zeros(GRID.shape, np.bool_)
    mask[top:bottom, left:right] = True
    return mask
