"""Coverage of what a calibration needs by views of a board, as in ROS's camera_calibration.

Each view is measured by four numbers from 0 to 1 (``ViewMeasures``). A view is worth keeping if it
differs from all others by more than 0.2 in the sum of absolute differences. Each measure's bar is
the range that the views cover, from minimum to maximum for X and Y and from 0 for size and
skew, over the wanted range 0.7, 0.7, 0.4 and 0.5. All bars full, or 40 views, are enough
(image_pipeline, ``calibrator.py``: ``get_parameters``, ``is_good_sample``,
``compute_goodenough``).

Added here: both cameras of a pair are measured, and the emptier bar of the two counts; five views
that happen to fill the bars are not enough yet; and the reach of the board's corners towards each
of the four corners of the image, where lens distortion is largest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.calibration.boards.board import Board, BoardSighting
from observer.geometry import Float64Array

BARS = ("X", "Y", "Size", "Skew")
WANTED_RANGES = (0.7, 0.7, 0.4, 0.5)
IMAGE_CORNERS = ("upper left", "upper right", "lower left", "lower right")
# Sum of absolute differences of the four measures above which two views are both worth keeping.
NEW_DISTANCE = 0.2
# So many views are enough even if a bar is not full.
MANY_VIEWS = 40
# Fewer views do not average out the corners' noise, whatever they cover.
FEWEST_VIEWS = 12
# Share of the way from the image's centre to its corner, in both x and y: a board seen whole by two
# cameras side by side reaches no further than about 0.8.
WANTED_REACH = 0.55

_MISSING = (
    "the left and right of the image",
    "the top and bottom of the image",
    "a close-up view",
    "a view with the board tilted",
)


@dataclass(frozen=True, eq=False)
class ViewMeasures:
    """Measures of one camera's view of a board, or of both cameras' view, or of many views.

    With the quadrangle of the board's outermost corners (of a board seen in part: of the largest
    rectangle of corners seen), its area A and an image of w x h pixels: x = (mean u - sqrt(A)/2) /
    (w - sqrt(A)), y alike, size = sqrt(A / (w h)), skew = 2 |pi/2 - angle at the upper right
    corner|, each held within 0..1.

    Attributes:
        values: (..., 4) x, y, size and skew; of both cameras (2, 4).
        reach: (..., 4) how far the board's corners reach towards the image's upper left, upper
            right, lower left and lower right corner: 0 at the centre, 1 in the corner.
    """

    values: Float64Array
    reach: Float64Array

    def beside(self, right: ViewMeasures) -> ViewMeasures:
        """Return the measures (..., 2, 4) of both cameras, where these are of the left one."""
        both = (self.values, right.values), (self.reach, right.reach)
        return ViewMeasures(*(np.stack(each, axis=-2) for each in both))

    def distance(self, other: ViewMeasures) -> float:
        """Sum of absolute differences of the measures (2, 4), the mean over the cameras."""
        return float(np.abs(self.values - other.values).sum(axis=1).mean())


@dataclass(frozen=True)
class Coverage:
    """Coverage of a set of views.

    Attributes:
        bars: X, Y, Size and Skew by name, each 0..1, the emptier of both cameras.
        reached: by image corner, 0..1: reach of the board's corners over the wanted one; the
            lesser of both cameras.
        views: number of views.
    """

    bars: dict[str, float]
    reached: dict[str, float]
    views: int

    @property
    def enough(self) -> bool:
        """True once a calibration may be computed: all bars full and some views, or very many."""
        full = all(bar >= 1 for bar in self.bars.values())
        return (full and self.views >= FEWEST_VIEWS) or self.views >= MANY_VIEWS

    @property
    def missing(self) -> tuple[str, ...]:
        """Return in words what is still to be shown, the most needed first."""
        bars = [words for words, bar in zip(_MISSING, self.bars.values(), strict=True) if bar < 1]
        corners = [f"the {name} corner of the image" for name, r in self.reached.items() if r < 1]
        more = FEWEST_VIEWS - self.views
        count = [f"{more} more view{'s' * (more > 1)}"] if more > 0 and not bars else []
        return (*bars, *count, *corners)


def measure_view(
    sighting: BoardSighting, board: Board, image_size: tuple[int, int]
) -> ViewMeasures | None:
    """Measures of one view in an image of (width, height); None if no rectangle of it is seen."""
    quadrangle = _quadrangle(sighting, board)
    if quadrangle is None:
        return None
    measured = measure_outline(quadrangle[None], sighting.px[None], image_size)
    return ViewMeasures(measured.values[0], measured.reach[0])


def measure_outline(
    quadrangles: Float64Array, px: Float64Array, image_size: tuple[int, int]
) -> ViewMeasures:
    """Measures of M views at once.

    Args:
        quadrangles: (M, 4, 2) outermost corners, by the board's upper left, upper right, lower
            right and lower left.
        px: (M, N, 2) all corners.
        image_size: width and height, pixels.
    """
    size = np.array(image_size, dtype=np.float64)
    first, second = quadrangles[:, 2] - quadrangles[:, 0], quadrangles[:, 3] - quadrangles[:, 1]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    border = np.minimum(np.sqrt(area), 0.99 * size.min())[:, None]
    # Shrink the image by about half a board all around, else large boards cannot cover the range.
    place = (px.mean(axis=1) - border / 2) / (size - border)
    a, b = quadrangles[:, 0] - quadrangles[:, 1], quadrangles[:, 2] - quadrangles[:, 1]
    cosine = (a * b).sum(1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + 1e-12)
    skew = 2 * np.abs(np.pi / 2 - np.arccos(np.clip(cosine, -1, 1)))
    values = np.column_stack([place, np.sqrt(area / size.prod()), skew]).clip(0, 1)
    out = (px - (size - 1) / 2) / (size / 2)
    reach = [
        np.minimum(su * out[..., 0], sv * out[..., 1]).max(axis=1).clip(0, 1)
        for su, sv in ((-1, -1), (1, -1), (-1, 1), (1, 1))
    ]
    return ViewMeasures(values, np.stack(reach, axis=1))


def coverage(views: Sequence[ViewMeasures], wanted: tuple[float, ...] = WANTED_RANGES) -> Coverage:
    """Return how much of the wanted ranges of X, Y, size and skew these views cover together."""
    if not views:
        return Coverage(dict.fromkeys(BARS, 0.0), dict.fromkeys(IMAGE_CORNERS, 0.0), 0)
    values, reach = stacked(views)
    bars, reached = progress(values.min(axis=0), values.max(axis=0), reach.max(axis=0), wanted)
    return Coverage(
        dict(zip(BARS, bars.tolist(), strict=True)),
        dict(zip(IMAGE_CORNERS, reached.tolist(), strict=True)),
        len(views),
    )


def stacked(views: Sequence[ViewMeasures]) -> tuple[Float64Array, Float64Array]:
    """Values and reach of views, both (N, 2, 4): by view, camera and measure."""
    values, reach = [view.values for view in views], [view.reach for view in views]
    return np.array(values).reshape(-1, 2, 4), np.array(reach).reshape(-1, 2, 4)


def progress(
    least: Float64Array,
    most: Float64Array,
    reach: Float64Array,
    wanted: tuple[float, ...] = WANTED_RANGES,
) -> tuple[Float64Array, Float64Array]:
    """Return how full the bars are and how far the image's corners are reached, (..., 4), 0..1.

    Args:
        least, most, reach: (..., 2, 4), extremes of the views' measures by camera.
        wanted: ranges that fill the bars.
    """
    low = np.concatenate([least[..., :2], np.zeros_like(least[..., 2:])], axis=-1)
    bars = ((most - low) / wanted).min(axis=-2).clip(0, 1)
    return bars, (reach / WANTED_REACH).min(axis=-2).clip(0, 1)


def is_new(view: ViewMeasures, kept: Sequence[ViewMeasures]) -> bool:
    """Return whether a view differs enough from all kept ones to be worth keeping."""
    return all(view.distance(other) > NEW_DISTANCE for other in kept)


def _quadrangle(sighting: BoardSighting, board: Board) -> Float64Array | None:
    """(4, 2) pixels: the outermost corners of the largest rectangle of corners seen."""
    number = np.full((board.rows, board.columns), -1)
    number[sighting.ids // board.columns, sighting.ids % board.columns] = np.arange(len(sighting))
    seen = number >= 0
    best, corners = 0, None
    for top in range(board.rows - 1):
        for bottom in range(board.rows - 1, top, -1):
            columns = np.flatnonzero(seen[top] & seen[bottom])
            if len(columns) < 2:
                continue
            first, last = columns[0], columns[-1]
            if (bottom - top) * (last - first) > best:
                best = (bottom - top) * (last - first)
                corners = [(top, first), (top, last), (bottom, last), (bottom, first)]
    if corners is None:
        return None
    return sighting.px[[number[place] for place in corners]]
