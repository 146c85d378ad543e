"""Choice of the points to track: evenly over the image, more densely where something moves."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.kernels.corners import is_cornered, strongest_of_cells, wanted_cells
from observer.parameters import KltTrackingParameters, Parameters
from observer.types import Image
from observer.vision.features import strongest_first

# Where something moves, cells are this many times smaller.
_FINER = 2
# Corners are detected in an image reduced by this factor: a window is tracked, so the corner need
# not be located to the pixel.
_REDUCTION = 2
# Side of the patch, in the reduced image, over which a corner is measured. It is smaller than the
# tracked window, so that the corner lies near the point and not at the window's edge.
_CORNER_PX = 3
# OpenCV's smaller eigenvalue is that of the mean gradient matrix in (2 / 255 grey levels/px)^2,
# and in the reduced image gradients are steeper.
_GREY_PER_ROOT = 255 / 2 / _REDUCTION
# Most empty cells are empty because nothing in them can be tracked; each is tried once in this
# many frames.
_TURNS = 2
# Strong points cluster, so several per cell must be detected for most cells to get one.
_CANDIDATES_PER_CELL = 8
# Share of the gradients of fine texture that remains after reducing the image, which smooths it.
_SMOOTHED = 0.5
# Side of the neighbourhood, in the reduced image, tested for being only a straight edge, and the
# ratio of the eigenvalues of its gradient matrix below which it is.
_EDGE_WINDOW = 7
_EDGE_RATIO = 0.05


def attention(
    size: tuple[int, int],
    boxes_px: NDArray[np.float64],
    px: NDArray[np.float32],
    parameters: KltTrackingParameters,
) -> NDArray[np.bool_]:
    """Return which cells of the image get more points, (rows, columns).

    Args:
        size: width and height of the image, pixels.
        boxes_px: (B, 4) pixels u0 v0 u1 v1 around obstacles.
        px: (N, 2) pixels of moving points.
    """
    side = parameters.spacing_px
    width, height = size
    rows, columns = -(-height // side), -(-width // side)
    marked = np.zeros((rows, columns), np.bool_)
    for u0, v0, u1, v1 in boxes_px:
        c0, c1 = int(max(u0, 0) // side), int(min(u1, width - 1) // side)
        r0, r1 = int(max(v0, 0) // side), int(min(v1, height - 1) // side)
        marked[r0 : max(r1 + 1, 0), c0 : max(c1 + 1, 0)] = True
    if len(px):
        near = np.zeros_like(marked)
        near[(px[:, 1] // side).astype(np.intp), (px[:, 0] // side).astype(np.intp)] = True
        marked |= cv2.dilate(near.view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return marked


def grid_cells(
    px: NDArray[np.float32], marked: NDArray[np.bool_], parameters: KltTrackingParameters
) -> NDArray[np.intp]:
    """Return the number (N,) of the cell of each point (N, 2) px; marked cells are divided."""
    rows, columns = marked.shape
    finer = (px * np.float32(_FINER / parameters.spacing_px)).astype(np.intp)
    column, row = finer[:, 0] // _FINER, finer[:, 1] // _FINER
    coarse = row * columns + column
    divided = rows * columns + finer[:, 1] * (columns * _FINER) + finer[:, 0]
    return np.asarray(np.where(marked[row, column], divided, coarse), np.intp)


def density_weights(
    px: NDArray[np.float32], parameters: KltTrackingParameters
) -> NDArray[np.float64]:
    """Return one over the number (N,) of points that share the cell of each point (N, 2) px."""
    column = (px[:, 0] // parameters.spacing_px).astype(np.intp)
    row = (px[:, 1] // parameters.spacing_px).astype(np.intp)
    cell = row * (column.max(initial=0) + 1) + column
    return np.asarray(1.0 / np.bincount(cell)[cell], np.float64)


def one_per_cell(cell: NDArray[np.intp], sightings: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the indices, ascending, of the longest tracked point in each cell.

    Args:
        cell: (N,) number of the cell each point is in.
        sightings: (N,) in how many frames each was seen.
    """
    order = np.lexsort((-sightings, cell))
    ordered = cell[order]
    first = np.ones(len(cell), np.bool_)
    first[1:] = ordered[1:] != ordered[:-1]
    return np.sort(order[first])


def new_keypoints(
    image: Image,
    taken: NDArray[np.intp],
    marked: NDArray[np.bool_],
    parameters: Parameters,
    turn: int | None = None,
) -> NDArray[np.float32]:
    """Return new points (N, 2) px: the strongest in every cell without a tracked point.

    The minimum eigenvalue, on which Lucas-Kanade depends, is evaluated per cell; the other
    detectors run on the whole image.

    Args:
        image: (H, W) grey. taken, marked, turn: as of ``strongest_corners``.

    Raises:
        InputError: ``surf`` is asked for and its extra is not installed.
    """
    p = parameters
    if p.features.detector == "shi_tomasi":
        return strongest_corners(image, taken, marked, p.klt_tracking, turn)
    px = strongest_first(image, p.features, marked.size * _CANDIDATES_PER_CELL)
    height, width = image.shape
    return px[first_in_empty(px, (width, height), taken, marked, p.klt_tracking, turn)]


def strongest_corners(
    image: Image,
    taken: NDArray[np.intp],
    marked: NDArray[np.bool_],
    parameters: KltTrackingParameters,
    turn: int | None = None,
) -> NDArray[np.float32]:
    """Return the strongest corner (N, 2) px in every cell without a tracked point.

    The strength of a corner is the smaller eigenvalue of its gradient matrix, on which
    Lucas-Kanade depends (Shi and Tomasi: Good Features to Track, CVPR 1994).

    Args:
        image: (H, W) grey. taken: numbers of the cells that have a point, as of ``grid_cells``.
        marked: (rows, columns) of ``attention``.
        turn: frame number; only one in ``_TURNS`` of the unmarked cells is searched, in turn from
            frame to frame. None searches all of them.
    """
    strength = np.asarray(cv2.cornerMinEigenVal(cv2.pyrDown(image), _CORNER_PX), np.float32)
    # The least strength of a corner that can be tracked.
    least = (_SMOOTHED * parameters.min_texture / _GREY_PER_ROOT) ** 2
    found = strongest_of_cells(
        strength,
        marked,
        _wanted(taken, marked, turn),
        _FINER,
        # Lucas-Kanade's window must lie in the image.
        -(-(parameters.window_px // 2 + 1) // _REDUCTION),
        np.float32(_REDUCTION * _FINER / parameters.spacing_px),
        np.float32(least),
    )
    return found.astype(np.float32) * np.float32(_REDUCTION)


def first_in_empty(
    px: NDArray[np.float32],
    size: tuple[int, int],
    taken: NDArray[np.intp],
    marked: NDArray[np.bool_],
    parameters: KltTrackingParameters,
    turn: int | None = None,
) -> NDArray[np.intp]:
    """Return the indices of the first of points (N, 2) px in every cell without a tracked point.

    Args:
        size: width and height of the image, pixels.
        taken, marked, turn: as of ``strongest_corners``.
    """
    # Lucas-Kanade's window must lie in the image.
    margin = parameters.window_px // 2 + 1
    low, high = np.float32(margin), np.array(size, np.float32) - margin
    finer = (px * np.float32(_FINER / parameters.spacing_px)).astype(np.intp)
    chosen = _wanted(taken, marked, turn)[finer[:, 1], finer[:, 0]]
    chosen &= (px >= low).all(axis=1) & (px < high).all(axis=1)
    index = np.flatnonzero(chosen)
    _, first = np.unique(grid_cells(px[index], marked, parameters), return_index=True)
    return np.asarray(index[first], np.intp)


def _wanted(
    taken: NDArray[np.intp], marked: NDArray[np.bool_], turn: int | None
) -> NDArray[np.bool_]:
    """(2 rows, 2 columns) in which of the finer cells a new point is wanted."""
    number, turns = (0, 1) if turn is None else (turn, _TURNS)
    return wanted_cells(np.ascontiguousarray(taken, np.int64), marked, _FINER, number, turns)


def has_corner(image: Image, px: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) whether the texture at pixels (N, 2) varies in more than one direction.

    Tested by the eigenvalues of the gradient matrix in the reduced image, since noise at full
    resolution would look like texture along an edge. Along a straight edge a match may slide.
    """
    scale = 1 / _REDUCTION
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    across, down = (np.asarray(gradient, np.int16) for gradient in cv2.spatialGradient(small))
    return is_cornered(
        across, down, np.ascontiguousarray(px, np.float32), _REDUCTION, _EDGE_WINDOW, _EDGE_RATIO
    )
