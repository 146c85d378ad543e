"""Selection of usable views of a board, and their corners as input of an adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import FEWEST_CORNERS, Board, BoardSighting, BoardView
from observer.calibration.fitting.adjustment import Corners
from observer.calibration.fitting.outlier_views import ViewError
from observer.geometry import Float64Array

# Share of the image's size: a corner this far outside was never found in the image.
_OUTSIDE = 0.02
# Ratio of the corners' smaller to their larger spread, below which they are collinear.
_LEAST_SPREAD = 0.01


def refused_sightings(
    views: Sequence[BoardView], board: Board, width: int, height: int
) -> dict[int, ViewError]:
    """Return the unusable views, by index."""
    refused = {}
    for index, view in enumerate(views):
        left = _problem(view.left, "left", board, width, height)
        reason = left or _problem(view.right, "right", board, width, height)
        if view.left is None and view.right is None:
            reason = "the board was not found in either image"
        if reason is not None:
            refused[index] = ViewError(view.name, False, reason)
    return refused


def corners_of(
    views: Sequence[BoardView], board: Board, usable: NDArray[np.bool_]
) -> tuple[Corners, Corners]:
    """The corners of both cameras in the usable (V,) views."""
    seen = [(index, views[index]) for index in np.flatnonzero(usable).tolist()]
    points = board.object_points
    return (
        _joined([(index, view.left) for index, view in seen], points),
        _joined([(index, view.right) for index, view in seen], points),
    )


def without(
    views: Sequence[BoardView], camera: int, corners: Corners, strays: NDArray[np.bool_]
) -> list[BoardView]:
    """Return the views without the stray corners (N,) of one camera."""
    name = ("left", "right")[camera]
    out = list(views)
    for index in np.unique(corners.view[strays]).tolist():
        old = getattr(views[index], name)
        kept = ~strays[corners.view == index]
        out[index] = replace(views[index], **{name: BoardSighting(old.ids[kept], old.px[kept])})
    return out


def _joined(sightings: Sequence[tuple[int, BoardSighting | None]], points: Float64Array) -> Corners:
    seen = [(index, each) for index, each in sightings if each is not None]
    view = [np.full(len(each), index, dtype=np.intp) for index, each in seen]
    ids = [each.ids for _, each in seen]
    return Corners(
        np.concatenate([np.zeros(0, np.intp), *view]),
        points[np.concatenate([np.zeros(0, np.int32), *ids])],
        np.concatenate([np.zeros((0, 2)), *(np.asarray(e.px, np.float64) for _, e in seen)]),
    )


def _problem(
    sighting: BoardSighting | None, camera: str, board: Board, width: int, height: int
) -> str | None:
    if sighting is None:
        return None
    if len(sighting) < FEWEST_CORNERS:
        return (
            f"the {camera} image shows {len(sighting)} corners; at least {FEWEST_CORNERS} are "
            "needed to estimate the board's pose"
        )
    if sighting.ids[0] < 0 or sighting.ids[-1] >= board.corner_count:
        return (
            f"its corners in the {camera} image are numbered up to {sighting.ids.max()}, but a "
            f"{board.words} has {board.corner_count}"
        )
    px = np.asarray(sighting.px, np.float64)
    if not np.isfinite(px).all():
        return f"a corner in the {camera} image has no position"
    room = _OUTSIDE * max(width, height)
    if (px < -room).any() or (px > np.array([width, height]) + room).any():
        return (
            f"a corner in the {camera} image lies outside it; the views must be of "
            f"{width}x{height} pixels"
        )
    for place in (px, board.object_points[sighting.ids, :2]):
        wide = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
        if not wide[1] > _LEAST_SPREAD * wide[0]:
            return f"its corners in the {camera} image are collinear"
    return None
