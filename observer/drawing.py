"""Drawing on images; colours are BGR."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from observer.obstacle_colors import obstacle_rgb
from observer.types import Image, Unseen

Color = tuple[int, int, int]

# Share of an obstacle's colour within its silhouette.
_TINT = 0.25
# Colour of the texts: small letters in the darker colours of obstacles are hard to read.
_LETTERS: Color = (255, 255, 255)
TEXT_SCALE = 0.45
_FONT = cv2.FONT_HERSHEY_SIMPLEX
# Pixels between an obstacle's box and the text above it, and least distance of the text's baseline
# from the image's upper border at text scale 1.
_ABOVE_PX, _LETTER_PX = 6, 28
# Colour of a thin stroke across each cell, and its share when blended with the image.
_HATCH, _HATCH_SHARE = (200, 120, 200), 0.5


def color_copy(image: Image) -> Image:
    """Return a BGR copy, (H, W, 3), of a grey or BGR image."""
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    return image.copy()


def obstacle_color(state: str, motion: str) -> Color:
    """Return the colour of an obstacle in this ``TrackState`` and ``MotionState``."""
    red, green, blue = obstacle_rgb(state, motion)
    return blue, green, red


class DrawnObstacle(NamedTuple):
    """Drawing of an obstacle.

    ``box_px`` and ``silhouette`` are those of ``Obstacle``; ``color`` is that of both.
    """

    box_px: Sequence[float]
    silhouette: Sequence[ArrayLike] | None
    text: str
    color: Color


class _Area(NamedTuple):
    """Pixels of a text: u from ``left`` to ``right``, v from ``top`` to ``bottom``."""

    left: int
    top: int
    right: int
    bottom: int

    def at_row(self, top: int) -> _Area:
        return self._replace(top=top, bottom=top + self.bottom - self.top)

    def overlaps(self, other: _Area) -> bool:
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )


def draw_obstacles(
    canvas: Image, obstacles: Iterable[DrawnObstacle], scale: float = TEXT_SCALE
) -> None:
    """Draw each obstacle's tinted silhouette, its box, and a text above it, if it is in view.

    No text covers another, as far as there is room.

    Args:
        canvas: (H, W, 3). scale: of the texts.
    """
    taken: list[_Area] = []
    texts: list[tuple[DrawnObstacle, _Area, int]] = []
    for each in obstacles:
        if not _draw_shape(canvas, each):
            continue
        wanted, baseline = _text_area(each, scale, canvas.shape[1])
        area = _free_area(wanted, taken, canvas.shape[0])
        taken.append(area)
        texts.append((each, area, baseline))
    for each, area, baseline in texts:
        draw_text(canvas, each.text, (area.left, area.bottom - baseline), _LETTERS, scale)


def _draw_shape(canvas: Image, obstacle: DrawnObstacle) -> bool:
    """Draw silhouette and box; return whether the box is in view."""
    box_px, silhouette, _, color = obstacle
    if silhouette:
        tint(canvas, silhouette_mask(silhouette, canvas.shape[:2]), color, _TINT)
        cv2.polylines(canvas, _corners(silhouette), True, color, 1, cv2.LINE_AA)
    u0, v0, u1, v1 = (round(value) for value in box_px)
    if u1 < 0 or v1 < 0 or u0 >= canvas.shape[1] or v0 >= canvas.shape[0]:
        return False
    cv2.rectangle(canvas, (u0, v0), (u1, v1), color, 2, cv2.LINE_AA)
    return True


def _text_area(obstacle: DrawnObstacle, scale: float, image_width: int) -> tuple[_Area, int]:
    """Return where an obstacle's text belongs, and how far its baseline is above the bottom.

    Its ends are within the image, if it is wide enough.
    """
    u0, v0 = (round(value) for value in obstacle.box_px[:2])
    (width, height), below = cv2.getTextSize(obstacle.text, _FONT, scale, 3)
    baseline = max(v0 - _ABOVE_PX, round(_LETTER_PX * scale))
    left = max(0, min(u0, image_width - width))
    return _Area(left, baseline - height, left + width, baseline + below), below


def _free_area(wanted: _Area, taken: Sequence[_Area], height: int) -> _Area:
    """Return the wanted area in the nearest row that the taken ones leave free.

    Where there is none, the wanted one.
    """
    size = wanted.bottom - wanted.top
    rows = [wanted.top, *(row for other in taken for row in (other.top - size, other.bottom))]
    for row in sorted(rows, key=lambda row: abs(row - wanted.top)):
        area = wanted.at_row(row)
        inside = row == wanted.top or (row >= 0 and area.bottom <= height)
        if inside and not any(area.overlaps(other) for other in taken):
            return area
    return wanted


def draw_text(
    canvas: Image, text: str, at: tuple[int, int], color: Color, scale: float = TEXT_SCALE
) -> None:
    """Write a text with a dark border; its lower left corner is at a pixel (u, v)."""
    # OpenCV's font has only ASCII: a plus-minus sign is drawn as a plus with a line added below.
    shown = text.replace("±", "+")
    lines = [_line_below(shown, at, place, scale) for place, c in enumerate(text) if c == "±"]
    for thickness, ink in ((3, (0, 0, 0)), (1, color)):
        cv2.putText(canvas, shown, at, _FONT, scale, ink, thickness, cv2.LINE_AA)
        for start, end in lines:
            cv2.line(canvas, start, end, ink, thickness, cv2.LINE_AA)


def _line_below(
    text: str, at: tuple[int, int], place: int, scale: float
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the ends of a line below one character of a text written at a pixel (u, v)."""
    begin, end = (
        at[0] + cv2.getTextSize(text[:count], _FONT, scale, 1)[0][0] for count in (place, place + 1)
    )
    v = at[1] + round(4 * scale)
    return (begin + round(4 * scale), v), (end - round(4 * scale), v)


def silhouette_mask(
    silhouette: Sequence[ArrayLike], shape: tuple[int, ...], reduction: int = 1
) -> NDArray[np.bool_]:
    """Return which pixels (H, W) lie on a silhouette.

    Args:
        silhouette: as of ``Obstacle``. shape: H, W. reduction: pixels of the silhouette's image
            per pixel of the mask.
    """
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, _corners(silhouette, reduction), 1)
    return mask.view(np.bool_)


def tint(canvas: Image, mask: NDArray[np.bool_], color: Color, share: float) -> None:
    """Mix a colour into the pixels of a mask (H, W), by a share from 0 to 1."""
    u, v, width, height = cv2.boundingRect(mask.view(np.uint8))
    if width == 0:
        return
    window = slice(v, v + height), slice(u, u + width)
    ink = np.full((height, width, 3), color, np.uint8)
    mixed = cv2.addWeighted(canvas[window], 1 - share, ink, share, 0.0)
    cv2.copyTo(mixed, mask[window].view(np.uint8), canvas[window])


def hatch_unseen(canvas: Image, unseen: Unseen) -> None:
    """Hatch where motion would go unnoticed, on a BGR canvas of the left image's size."""
    side = unseen.cell_px
    corners = [
        (side * column, side * row)
        for row, letters in enumerate(unseen.rows)
        for column, letter in enumerate(letters)
        if letter != "."
    ]
    strokes = [np.array([(u, v + side), (u + side, v)], np.int32) for u, v in corners]
    drawn = canvas.copy()
    cv2.polylines(drawn, strokes, False, _HATCH, 1, cv2.LINE_AA)
    cv2.addWeighted(drawn, _HATCH_SHARE, canvas, 1 - _HATCH_SHARE, 0, dst=canvas)


def _corners(silhouette: Sequence[ArrayLike], reduction: int = 1) -> list[NDArray[np.int32]]:
    return [(np.asarray(each) // reduction).astype(np.int32) for each in silhouette]
