"""Segments: connected cells of one depth that stand apart from what is beside and behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.segments import described, grown
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED, UNKNOWN
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.scene import DenseScene
from observer.robust import median
from observer.types import BoxPx

Mask = NDArray[np.bool_]
Window = tuple[slice, slice]

# The trunk is in this upper share of the rows; legs swing below it.
TRUNK_SHARE = 0.6
# Height over width of what is upright: a walking person is taller than wide, a robot is not.
UPRIGHT = 1.2
# Least area of a seed, of a segment and of one that is clear-cut, m^2, and of all three, cells.
_SEED_M2, SEGMENT_M2, _SMALL_M2, LEAST_CELLS = 0.03, 0.08, 0.03, 12
_MOST_SEEDS = 12
# Metres by which a segment may grow from a seed into what is static, or beyond where it was
# expected: two things that touch are not to become one.
_GROWTH_M = 0.12
# Matched columns: least step of the disparity that is no noise.
_STEP_COLUMNS = 0.5
# A body's border shows something farther on this share of its comparable cells, and on this share
# of all of them, or on more for a body that was uncovered rather than has arrived. Beside a near
# body there is much that only one camera sees: less is enough if it fills so much of the view, and
# so much of it has arrived, or was uncovered while its border stands apart this clearly.
_APART, _CLEAR, _CLEAR_UNCOVERED, _CLEAR_NEAR = 0.6, 0.2, 0.35, 0.1
_NEAR_SHARE, _MOVED_SHARE, _APART_AWAY = 0.05, 0.7, 0.8
# Shares of the cells that arrived, of the comparable and of all border cells that stand apart, and
# of the box that is filled, from which a segment is clear-cut.
_ARRIVED_CUT, _APART_CUT, _CLEAR_CUT, _FILLED_CUT = 0.5, 0.95, 0.5, 0.5
# A cell may belong to an expected body up to so many tolerances from its disparity.
_OWN_TOLERANCES = 1.5
# Metres, and share of the view's height: a segment as high as either is no patch of noise.
_PERSON_PART_M, _VIEW_SHARE = 0.8, 0.6
# A limb is at most so many metres from its body, and either above or below it, in this share of the
# columns, or smaller than this share of it. It differs by at most so many tolerances to be joined
# to the body, and to be a limb, or seen between limbs, at all.
_LIMB_M, _STACKED_SHARE, _LIMB_SHARE = 0.25, 0.6, 0.25
_LIMB_TOLERANCES, _GAP_TOLERANCES = 1.5, 2.5
# Cells around a part of a segment that show its contour.
_CONTOUR_CELLS = 1


@dataclass(frozen=True, eq=False)
class Segment:
    """One segment; columns and rows are cells.

    Attributes:
        mask: (h, w). box: first column and row, and those after the last.
        disparity: px, median of the trunk. area: cells.
        arrived, uncovered, static: shares of the cells that could be tested.
        apart: share of the comparable border beyond which the scene is farther. clear: share of
            the whole border.
        columns: of the trunk: mean left edge, middle and right edge.
        cut: True where the left, right, top and bottom border is not its own: the image's border
            or something nearer cuts it off.
        fine: px, the disparity of the trunk by its grey levels, see
            ``observer.methods.rigid.dense.fine_disparity``; None where they do not tell it.
    """

    mask: Mask
    box: tuple[int, int, int, int]
    disparity: float
    area: int
    arrived: float
    uncovered: float
    static: float
    apart: float
    clear: float
    columns: tuple[float, float, float]
    cut: tuple[bool, bool, bool, bool]
    fine: float | None = None

    @property
    def best_disparity(self) -> float:
        """px, by the grey levels where they tell it, else that of the cells."""
        return self.disparity if self.fine is None else self.fine

    @property
    def is_separate(self) -> bool:
        """True if it is a separate thing, and no part of a wall or a slope."""
        least = _CLEAR if self.arrived > self.uncovered else _CLEAR_UNCOVERED
        goes = self.uncovered > _MOVED_SHARE and self.apart > _APART_AWAY
        moved = goes or self.arrived > _MOVED_SHARE
        if moved and self.area > _NEAR_SHARE * self.mask.size:
            least = _CLEAR_NEAR
        return self.apart >= _APART and self.clear >= least

    @property
    def is_clear_cut(self) -> bool:
        """True if it is compact, and arrived apart from all around it: no noise, however small."""
        left, top, right, bottom = self.box
        filled = self.area / ((right - left) * (bottom - top))
        apart = self.apart >= _APART_CUT and self.clear >= _CLEAR_CUT
        return apart and self.arrived >= _ARRIVED_CUT and filled >= _FILLED_CUT


@dataclass(frozen=True, eq=False)
class Expected:
    """Place where a body should be seen: mask (h, w) and disparity, px."""

    mask: Mask
    disparity: float

    def as_segment(self, before: Segment) -> Segment:
        """Return the expected segment of a body that was last seen as ``before``."""
        rows, columns = window_of(self.mask)
        box = (columns.start, rows.start, columns.stop, rows.stop)
        return replace(before, mask=self.mask, box=box, disparity=self.disparity, fine=None)


def segment_of(scene: DenseScene, mask: Mask, trunk_share: float = TRUNK_SHARE) -> Segment:
    """Describe the cells of a mask (h, w), which must not be empty.

    Args:
        trunk_share: upper share of the rows that tells where it is.
    """
    box = _box_of(mask)
    (d, left, middle, right), evidence, (farther, same, around), cut = described(
        mask,
        np.array(box),
        scene.disparity,
        scene.evidence,
        scene.standing,
        scene.grid.reduction,
        trunk_share,
        _STEP_COLUMNS * scene.grid.column_px,
        *scene.tolerances,
    )
    tested = max(1, int(evidence.sum() - evidence[UNKNOWN]))
    return Segment(
        mask=mask,
        box=box,
        disparity=float(d),
        area=int(evidence.sum()),
        arrived=float(evidence[ARRIVED] / tested),
        uncovered=float(evidence[UNCOVERED] / tested),
        static=float(evidence[STATIC] / tested),
        apart=float(farther / max(1, farther + same)),
        clear=float(farther / max(1, around)),
        columns=(float(left), float(middle), float(right)),
        cut=(bool(cut[0]), bool(cut[1]), box[1] <= 1, box[3] >= scene.grid.height - 1),
    )


def fresh_segments(scene: DenseScene, free: Mask) -> list[Segment]:
    """List segments grown from what arrived in free space or was uncovered, largest seed first.

    Small ones come last, and only if they are clear-cut.

    Args:
        free: (h, w) cells that belong to nothing yet.
    """
    moved = (scene.evidence == ARRIVED) | (scene.evidence == UNCOVERED)
    seeds = opened(moved & scene.standing & free)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(seeds.view(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    left = scene.standing & free
    found, small = [], []
    for label in np.argsort(-areas, kind="stable")[:_MOST_SEEDS] + 1:
        column, row, width, height, area = stats[label].tolist()
        if area < LEAST_CELLS:
            break
        window = (slice(row, row + height), slice(column, column + width))
        segment = _grown_from(scene, window, labels[window] == label, left)
        if segment is None:
            continue
        if is_small(scene, segment):
            if segment.is_clear_cut:
                small.append(segment)
        elif segment.is_separate:
            left &= ~segment.mask
            found.append(segment)
    return found + [segment for segment in small if left[segment.mask].all()]


def _grown_from(scene: DenseScene, window: Window, part: Mask, free: Mask) -> Segment | None:
    """Return the segment grown from a seed, a part of a window; None if either is too small."""
    part = part & free[window]
    area = np.count_nonzero(part)
    if area < LEAST_CELLS:
        return None
    d = median(scene.disparity[window][part])
    if area < least_cells(scene, _SEED_M2, d):
        return None
    seed = np.zeros_like(free)
    seed[window] = part
    mask = grown_mask(scene, free, seed, _widened(scene, seed, d), d)
    if mask is None or np.count_nonzero(mask) < least_cells(scene, _SMALL_M2, d):
        return None
    return segment_of(scene, mask)


def followed_segment(
    scene: DenseScene, expected: Expected, core: Mask, free: Mask, *, grows: bool, small: bool
) -> Segment | None:
    """Return the segment at which a body was expected, grown from its core; None if it is gone.

    Args:
        core: (h, w) the cells that are most likely its own. free: those that it may take.
        grows: whether it may grow beyond where it was expected; a body that stands may not.
        small: whether the body is small, so that less of it may be left.
    """
    if np.count_nonzero(core) < LEAST_CELLS:
        return None
    d = median(scene.disparity[core])
    near = _widened(scene, expected.mask, d) if grows else expected.mask
    mask = grown_mask(scene, scene.standing & free & near, core, expected.mask, d)
    least_m2 = (_SMALL_M2 if small else SEGMENT_M2) / 2
    if mask is None or np.count_nonzero(mask) < least_cells(scene, least_m2, d):
        return None
    return segment_of(scene, mask)


def owners(scene: DenseScene, bodies: list[Expected]) -> NDArray[np.int16]:
    """(h, w) number of the expected body to which each cell most likely belongs; -1 none."""
    owner = np.full(scene.grid.shape, -1, np.int16)
    best = np.full(scene.grid.shape, _OWN_TOLERANCES, np.float32)
    for number, body in enumerate(bodies):
        window = window_of(body.mask)
        tolerance = np.float32(scene.tolerance(body.disparity))
        off = np.abs(scene.disparity[window] - np.float32(body.disparity)) / tolerance
        better = body.mask[window] & scene.standing[window] & (off < best[window])
        best[window][better] = off[better]
        owner[window][better] = number
    return owner


def is_limb(scene: DenseScene, part: Segment, body: Segment) -> bool:
    """Return whether a segment is a limb of a body, the rest of it, or seen between its limbs."""
    if _gap(scene, part, body) > _GAP_TOLERANCES:
        return False
    reach = _LIMB_M * scene.grid.per_metre(body.disparity)
    a, b = part.box, body.box
    if a[0] > b[2] + reach or a[2] < b[0] - reach or a[1] > b[3] + reach or a[3] < b[1] - reach:
        return False
    shared = min(a[2], b[2] + reach / 2) - max(a[0], b[0] - reach / 2)
    # If only a part of a body was seen, the rest may be larger.
    stacked = shared >= _STACKED_SHARE * min(a[2] - a[0], b[2] - b[0])
    return stacked or part.area < _LIMB_SHARE * body.area


def with_limb(scene: DenseScene, body: Segment, limb: Segment) -> Segment:
    """Return the body with its limb, unless that is rather something seen between its limbs."""
    if _gap(scene, limb, body) > _LIMB_TOLERANCES:
        return body
    return segment_of(scene, body.mask | limb.mask)


def window_of(mask: Mask, more: int = 0) -> Window:
    """Return rows and columns of a mask (h, w), and ``more`` around; empty for an empty one."""
    left, top, right, bottom = _box_of(mask)
    h, w = mask.shape
    return (
        slice(max(0, top - more), min(h, bottom + more)),
        slice(max(0, left - more), min(w, right + more)),
    )


def upper_part(segment: Segment, share: float) -> NDArray[np.intp]:
    """(2, N) columns and rows of the cells in an upper share of a segment's rows, and around."""
    top, bottom = segment.box[1], segment.box[3]
    end = top + max(1, round(share * (bottom - top)))
    window = window_of(segment.mask, _CONTOUR_CELLS)
    first_row, first_column = window[0].start, window[1].start
    upper = segment.mask[window].astype(np.uint8)
    upper[end - first_row :] = 0
    side = 2 * _CONTOUR_CELLS + 1
    rows, columns = np.nonzero(cv2.dilate(upper, np.ones((side, side), np.uint8)))
    return np.stack([columns + first_column, rows + first_row])


def _box_of(mask: Mask) -> tuple[int, int, int, int]:
    """First column and row of a mask (h, w), and those after the last."""
    column, row, width, height = cv2.boundingRect(mask.view(np.uint8))
    return column, row, column + width, row + height


def widened(mask: Mask, reach: int) -> Mask:
    """Return the mask (h, w) dilated by so many cells to each side, as by a square."""
    window = window_of(mask, reach)
    wide = np.zeros_like(mask)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    wide[window] = cv2.dilate(mask[window].view(np.uint8), square).view(np.bool_)
    return wide


def opened(mask: Mask) -> Mask:
    """The mask (h, w) without what is thinner than three cells."""
    square = np.ones((3, 3), np.uint8)
    contiguous = np.ascontiguousarray(mask).view(np.uint8)
    return np.asarray(cv2.morphologyEx(contiguous, cv2.MORPH_OPEN, square)).view(np.bool_)


def _gap(scene: DenseScene, part: Segment, body: Segment) -> float:
    return abs(part.disparity - body.disparity) / scene.tolerance(body.disparity)


def least_cells(scene: DenseScene, area_m2: float, disparity: float) -> float:
    """Return how many cells an area, m^2, covers at a disparity, px; at least ``LEAST_CELLS``."""
    return max(LEAST_CELLS, area_m2 * scene.grid.per_metre(disparity) ** 2)


def is_small(scene: DenseScene, segment: Segment) -> bool:
    """Return whether a segment is smaller than a part of a person."""
    return segment.area < least_cells(scene, SEGMENT_M2, segment.disparity)


def _widened(scene: DenseScene, mask: Mask, disparity: float) -> Mask:
    """Return the mask (h, w) and what is so near to it that a body may have grown there."""
    return widened(mask, max(2, int(_GROWTH_M * scene.grid.per_metre(disparity))))


def grown_mask(
    scene: DenseScene, free: Mask, seed: Mask, may_be_static: Mask, disparity: float
) -> Mask | None:
    """(h, w) the free cells at the seed's depth that are connected to it; None without any.

    Static cells are left out, except for those that may be static.

    Args:
        free, seed, may_be_static: (h, w). disparity: px.
    """
    mask, count = grown(
        scene.disparity,
        scene.evidence,
        free,
        seed,
        may_be_static,
        np.float32(disparity),
        np.float32(scene.tolerance(disparity)),
    )
    return mask if count else None


def extent_m(segment: Segment, grid: Grid) -> tuple[float, float]:
    """Return the width and height of a segment, metres."""
    left, top, right, bottom = segment.box
    per_metre = grid.per_metre(segment.disparity)
    return (right - left) / per_metre, (bottom - top) / per_metre


def depth_gap_m(one: Segment, other: Segment, grid: Grid) -> float:
    """Return by how much one of two segments is farther away than the other, metres."""
    fb = grid.camera.fb
    return abs(fb / one.disparity - fb / other.disparity)


def is_high(segment: Segment, grid: Grid) -> bool:
    """Return whether a segment is as high as a part of a person, or fills much of the view."""
    view_m = grid.height / grid.per_metre(segment.disparity)
    _, height_m = extent_m(segment, grid)
    return height_m >= min(_PERSON_PART_M, _VIEW_SHARE * view_m)


def box_px(grid: Grid, segment: Segment) -> BoxPx:
    """Return u0, v0, u1, v1 around a segment, pixels of the left image."""
    corners: Float64Array = np.array(segment.box, np.float64).reshape(2, 2) - 0.5
    u0, v0, u1, v1 = grid.to_px(corners).ravel().tolist()
    return (u0, v0, u1, v1)
