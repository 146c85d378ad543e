"""Which points are worth following: evenly over the image, more densely where things move."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.parameters import FollowingParameters
from observer.types import Image

# Where something moves, squares are this many times smaller.
_FINER = 2


def attention(
    size: tuple[int, int],
    boxes_px: NDArray[np.float64],
    px: NDArray[np.float32],
    parameters: FollowingParameters,
) -> NDArray[np.bool_]:
    """(rows, columns) which squares of the image deserve more points.

    Args:
        size: width and height of the image. boxes_px: (B, 4) u0 v0 u1 v1 around obstacles.
        px: (N, 2) points that move.
    """
    side = parameters.spacing_px
    width, height = size
    rows, columns = -(-height // side), -(-width // side)
    marked = np.zeros((rows, columns), np.bool_)
    for u0, v0, u1, v1 in boxes_px:
        c0, c1 = int(max(u0, 0) // side), int(min(u1, width - 1) // side)
        r0, r1 = int(max(v0, 0) // side), int(min(v1, height - 1) // side)
        marked[r0 : r1 + 1, c0 : c1 + 1] = True
    if len(px):
        near = np.zeros_like(marked)
        near[(px[:, 1] // side).astype(np.intp), (px[:, 0] // side).astype(np.intp)] = True
        marked |= cv2.dilate(near.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return marked


def squares(
    px: NDArray[np.float32], marked: NDArray[np.bool_], parameters: FollowingParameters
) -> NDArray[np.intp]:
    """(N,) number of the square each point (N, 2) is in; marked squares are divided further."""
    side, fine = parameters.spacing_px, parameters.spacing_px / _FINER
    rows, columns = marked.shape
    row, column = (px[:, 1] // side).astype(np.intp), (px[:, 0] // side).astype(np.intp)
    coarse = row * columns + column
    finer = (px[:, 1] // fine).astype(np.intp) * (columns * _FINER)
    finer += (px[:, 0] // fine).astype(np.intp)
    return np.where(marked[row, column], rows * columns + finer, coarse)


def crowding(px: NDArray[np.float32], parameters: FollowingParameters) -> NDArray[np.float64]:
    """(N,) one over the number of points that share a point's square."""
    column = (px[:, 0] // parameters.spacing_px).astype(np.intp)
    row = (px[:, 1] // parameters.spacing_px).astype(np.intp)
    square = row * (column.max(initial=0) + 1) + column
    return 1.0 / np.bincount(square)[square]


def thinned(square: NDArray[np.intp], sightings: NDArray[np.int64]) -> NDArray[np.intp]:
    """Indices of the longest followed point in each square."""
    order = np.lexsort((-sightings, square))
    return np.sort(order[_firsts(square[order])])


def new_points(
    image: Image,
    taken: NDArray[np.intp],
    marked: NDArray[np.bool_],
    parameters: FollowingParameters,
) -> NDArray[np.float32]:
    """The strongest corner (N, 2) of every square in which no point is followed.

    Args:
        image: (H, W) grey. taken: numbers of the squares that have one.
    """
    keypoints = cv2.FastFeatureDetector.create(parameters.fast_threshold).detect(image)
    if not keypoints:
        return np.zeros((0, 2), np.float32)
    height, width = image.shape
    px = np.asarray(cv2.KeyPoint.convert(keypoints), np.float32)
    margin = parameters.window_px / 2
    limits = (width - 1 - margin, height - 1 - margin)
    square = squares(px, marked, parameters)
    free = np.ones(square.max() + 1, np.bool_)
    free[taken[taken < len(free)]] = False
    chosen = np.flatnonzero(free[square] & ((px >= margin) & (px <= limits)).all(axis=1))
    response = np.fromiter((keypoints[i].response for i in chosen), np.float32, len(chosen))
    px, square = px[chosen], square[chosen]
    order = np.lexsort((px[:, 0], px[:, 1], -response, square))
    return px[order[_firsts(square[order])]]


def _firsts(ordered: NDArray[np.intp]) -> NDArray[np.bool_]:
    first = np.ones(len(ordered), np.bool_)
    first[1:] = ordered[1:] != ordered[:-1]
    return first
