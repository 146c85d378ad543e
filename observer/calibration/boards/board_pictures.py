"""A camera's image with the board in it: its corners, earlier views, and where it should go.

Drawn on copies; colours are BGR.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import Board, BoardSighting
from observer.drawing import color_copy
from observer.geometry import Float64Array
from observer.types import Image

_SEEN = (80, 230, 80)
_KEPT = (200, 160, 60)
_GHOST = (40, 200, 255)
_SHIFT = 3
_PICTURE_WIDTH = 160
_PICTURE_QUALITY = 75
_KEPT_OPACITY = 0.25
_GHOST_OPACITY = 0.3


def draw_board(
    image: Image,
    board: Board,
    seen: BoardSighting | None,
    kept: Iterable[BoardSighting],
    ghost: Float64Array | None,
) -> Image:
    """Return the image to watch while moving the board.

    Args:
        seen: the board in this image. kept: captured before, drawn faintly.
        ghost: (4, 2) pixels, the outline of where it should go next; None draws none.
    """
    canvas = color_copy(image)
    # Hairlines would vanish when a large image is shown small.
    width = max(1, round(canvas.shape[1] / 400))
    # Where the board has been is one faint area, so that missing areas stand out.
    hulls = [_hull(sighting) for sighting in kept]
    if hulls:
        shade = canvas.copy()
        for hull in hulls:
            cv2.fillConvexPoly(shade, hull, _KEPT, cv2.LINE_AA, _SHIFT)
        canvas = _blended(canvas, shade, _KEPT_OPACITY)
    if ghost is not None:
        shade = canvas.copy()
        cv2.fillPoly(shade, [_fixed(ghost)], _GHOST, cv2.LINE_AA, _SHIFT)
        canvas = _blended(canvas, shade, _GHOST_OPACITY)
        cv2.polylines(canvas, [_fixed(ghost)], True, _GHOST, 2 * width, cv2.LINE_AA, _SHIFT)
    if seen is not None:
        _draw_corners(canvas, board, seen, width)
    return canvas


def small_picture(image: Image, seen: BoardSighting | None) -> bytes:
    """Return a thumbnail JPEG of the image with the board's outline, to recognise a view by."""
    factor = _PICTURE_WIDTH / image.shape[1]
    size = (_PICTURE_WIDTH, max(1, round(image.shape[0] * factor)))
    small = color_copy(np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8))
    if seen is not None:
        # Pixel centres are at whole numbers, so scaling applies to the pixels' edges.
        px = (seen.px + 0.5) * factor - 0.5
        cv2.polylines(
            small, [_hull(BoardSighting(seen.ids, px))], True, _SEEN, 1, cv2.LINE_AA, _SHIFT
        )
    _, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _PICTURE_QUALITY])
    return jpeg.tobytes()


def _draw_corners(canvas: Image, board: Board, seen: BoardSighting, width: int) -> None:
    places = dict(zip(seen.ids.tolist(), seen.px, strict=True))
    for row in range(board.rows):
        line = [places[i] for c in range(board.columns) if (i := row * board.columns + c) in places]
        if len(line) > 1:
            points = _fixed(np.array(line))
            cv2.polylines(canvas, [points], False, _SEEN, width, cv2.LINE_AA, _SHIFT)
    radius = (2 * width) << _SHIFT
    for point in _fixed(seen.px).tolist():
        cv2.circle(canvas, point, radius, _SEEN, -1, cv2.LINE_AA, _SHIFT)


def _hull(seen: BoardSighting) -> NDArray[np.int32]:
    return np.asarray(cv2.convexHull(_fixed(seen.px)), np.int32)


def _fixed(px: Float64Array) -> NDArray[np.int32]:
    """Pixels (N, 2) in OpenCV's fixed-point drawing coordinates, clipped far outside the image."""
    return np.round(np.asarray(px) * (1 << _SHIFT)).clip(-(2**22), 2**22).astype(np.int32)


def _blended(canvas: Image, shade: Image, share: float) -> Image:
    return np.asarray(cv2.addWeighted(shade, share, canvas, 1 - share, 0), np.uint8)
