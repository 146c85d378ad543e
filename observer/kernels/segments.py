"""Segments: connected cells of similar depth, separate from what is beside and behind them."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    BYTES2,
    FLAGS2,
    REAL,
    SINGLE,
    SINGLES2,
    WHOLE,
    WHOLES1,
    Bytes,
    Flags,
    Indices,
    Ints,
    Reals,
    Singles,
    kernel,
    part,
)
from observer.kernels.free_space import ARRIVED, STATIC
from observer.kernels.small import median

# A connected part of a mask is left out if it holds fewer seed cells than this, or than this share
# of the part with most.
_LEAST_HITS, _PART_SHARE = 3, 0.1
# Cells: outer and inner distance of the ring around a segment that shows what is behind it.
_RING, _RIM = 4, 1
# Columns: how far beside a segment it is tested whether it continues.
_BESIDE = 3
# A side is cut off if its true end is hidden on more than this share of the trunk's rows.
_CUT_SHARE = 0.25


@part
def _box(mask: Flags) -> tuple[int, int, int, int]:
    """Return first column and row of a mask (h, w), and those after the last; 0 last if empty."""
    h, w = mask.shape
    left, top, right, bottom = w, h, 0, 0
    for r in range(h):
        row = mask[r]
        any_here = False
        for c in range(w):
            any_here |= row[c]
        if any_here:
            top, bottom = min(top, r), r + 1
            c = 0
            while c < left and not row[c]:
                c += 1
            left = c
            c = w
            while c > right and not row[c - 1]:
                c -= 1
            right = c
    return left, top, right, bottom


@part
def _beside(cells: Bytes, step: int, out: Bytes) -> None:
    """Write which of cells (N,), 0 or 1, are set or have a set cell ``step`` before or after.

    The first and the last ``step`` of out (N,) stay as they are.
    """
    n = len(cells) - 2 * step
    # Views, so that the loop is vectorized.
    before, here, after = cells[:n], cells[step : step + n], cells[2 * step :]
    target = out[step : step + n]
    for i in range(n):
        target[i] = before[i] | here[i] | after[i]


@part
def _open(cells: Bytes, stride: int) -> None:
    """Invert the cells and open them, in place: removes what is thinner than three cells.

    Args:
        cells: (N,) 0 or 1, rows of ``stride`` with a border of 0, which stays 0 and does not
            erode what touches it.
    """
    across = np.zeros(len(cells), np.uint8)
    for turn in range(2):
        for step in (1, stride):
            _beside(cells if step == 1 else across, step, across if step == 1 else cells)
        if turn == 0:
            for i in range(len(cells)):
                cells[i] ^= 1
        for i in range(stride):
            cells[i] = cells[len(cells) - 1 - i] = 0
        for i in range(0, len(cells), stride):
            cells[i] = cells[i + stride - 1] = 0


@part
def _hang_together(cells: Bytes, seed: Bytes, stride: int, number: Ints, hits: Ints) -> int:
    """Number the connected parts that hold cells of a seed.

    Args:
        cells, seed: (N,) 0 or 1, rows of ``stride`` cells; the border is 0.
        number: (N,) 0, becomes the number of each cell's part. hits: (N,) becomes the number of
            seed cells in each part.

    Returns:
        Number of the last part; they count from 1.
    """
    stack = np.zeros(len(cells), np.int32)
    count = 0
    for start in range(len(cells)):
        if seed[start] & cells[start] == 0:
            continue
        if number[start] == 0:
            count += 1
            hits[count] = 0
            number[start] = count
            stack[0], depth = start, 1
            while depth > 0:
                depth -= 1
                at = stack[depth]
                for side in range(4):
                    step = stride if side >= 2 else 1
                    beside = at + step if side % 2 == 1 else at - step
                    if cells[beside] != 0 and number[beside] == 0:
                        number[beside] = count
                        stack[depth] = beside
                        depth += 1
        hits[number[start]] += 1
    return count


@kernel(SINGLES2, BYTES2, FLAGS2, FLAGS2, FLAGS2, SINGLE, SINGLE)
def grown(
    disparity: Singles,
    evidence: Bytes,
    free: Flags,
    seed: Flags,
    may_be_static: Flags,
    depth: np.float32,
    tolerance: np.float32,
) -> tuple[Flags, int]:
    """Find the free cells at a seed's depth that are connected with it.

    Static cells are left out, except those in ``may_be_static``.

    Args:
        disparity: (h, w) px, NaN unknown. evidence: (h, w), see ``observer.kernels.free_space``.
        free, seed, may_be_static: (h, w) masks.
        depth: px, disparity of the seed. tolerance: px, by which its cells' disparities may differ.

    Returns:
        The mask (h, w), and the number of its cells.
    """
    h, w = disparity.shape
    mask = np.empty((h, w), np.bool_)
    for r in range(h):
        d, e, out = disparity[r], evidence[r], mask[r]
        is_free, may_be = free[r], may_be_static[r]
        for c in range(w):
            fresh = (e[c] != STATIC) | may_be[c]
            out[c] = is_free[c] & fresh & (abs(d[c] - depth) < tolerance)
    left, top, right, bottom = _box(mask)
    if bottom == 0:
        return mask, 0
    height, width, stride = bottom - top, right - left, right - left + 2
    n = (height + 2) * stride
    cells, of_seed = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    for r in range(height):
        start = (r + 1) * stride + 1
        to_cells, to_seed = cells[start : start + width], of_seed[start : start + width]
        alike, of = mask[top + r][left:right], seed[top + r][left:right]
        for c in range(width):
            to_cells[c], to_seed[c] = not alike[c], of[c]
    _open(cells, stride)
    number, hits = np.zeros(n, np.int32), np.zeros(n, np.int32)
    parts = _hang_together(cells, of_seed, stride, number, hits)
    most, count = 0, 0
    for k in range(1, parts + 1):
        most = max(most, hits[k])
    kept = np.zeros(parts + 1, np.uint8)
    for k in range(1, parts + 1):
        kept[k] = hits[k] >= _LEAST_HITS and hits[k] >= _PART_SHARE * most
    for r in range(height):
        start = (r + 1) * stride + 1
        of_part, out = number[start : start + width], mask[top + r][left:right]
        for c in range(width):
            out[c] = kept[of_part[c]]
            count += out[c]
    return mask, count


@part
def _spread(values: Singles, stride: int, reach: int, out: Singles) -> None:
    """Write the largest of values (N,) within ``reach`` rows and columns of each to out (N,).

    Values of -1 are empty; each row of ``stride`` ends with at least ``reach`` of them, and so
    many empty rows lie at both ends.
    """
    across = np.full(len(values), np.float32(-1), np.float32)
    for turn in range(2):
        step = 1 if turn == 0 else stride
        source, target = (values, across) if turn == 0 else (across, out)
        margin = reach * step
        n = len(values) - 2 * margin
        middle = target[margin : margin + n]
        for k in range(2 * reach + 1):
            other = source[k * step : k * step + n]
            for i in range(n):
                middle[i] = other[i] if other[i] > middle[i] else middle[i]


@part
def _border(
    mask: Flags,
    disparity: Singles,
    standing: Flags,
    box: Indices,
    limit: np.float32,
    counts: Indices,
) -> None:
    """Count the cells around a mask (h, w): those farther, those at its depth, and all.

    Args:
        limit: px, by which a farther cell differs at least. counts: (3,) is written.
    """
    h, w = mask.shape
    left, top = max(0, box[0] - _RING), max(0, box[1] - _RING)
    right, bottom = min(w, box[2] + _RING), min(h, box[3] + _RING)
    stride = right - left + _RING
    n = (bottom - top + 2 * _RING) * stride
    own = np.full(n, np.float32(-1), np.float32)
    around, rim = own.copy(), own.copy()
    for r in range(top, bottom):
        for c in range(left, right):
            if mask[r, c]:
                own[(r - top + _RING) * stride + c - left] = disparity[r, c]
    for turn in range(2):
        reach = _RING if turn == 0 else _RIM
        _spread(own, stride, reach, around if turn == 0 else rim)
    counts[0] = counts[1] = counts[2] = 0
    for r in range(top, bottom):
        for c in range(left, right):
            i = (r - top + _RING) * stride + c - left
            if around[i] < 0 or rim[i] >= 0:
                continue
            step = around[i] - disparity[r, c]
            counts[0] += step > limit
            counts[1] += abs(step) <= limit and standing[r, c]
            counts[2] += 1


@kernel(FLAGS2, WHOLES1, SINGLES2, BYTES2, FLAGS2, WHOLE, REAL, REAL, REAL, REAL)
def described(
    mask: Flags,
    box: Indices,
    disparity: Singles,
    evidence: Bytes,
    standing: Flags,
    reduction: int,
    trunk_share: float,
    least_step: float,
    least_tolerance: float,
    thickness: float,
) -> tuple[Reals, Indices, Indices, tuple[bool, bool]]:
    """Describe a segment.

    Args:
        mask: (h, w), not empty. box: (4,) its first column and row, and those after the last.
        disparity: (h, w) px, NaN unknown; that of the mask is known.
        evidence: (h, w), see ``observer.kernels.free_space``.
        standing: (h, w) which cells stand out of the ground.
        reduction: pixels per cell. trunk_share: upper share of the rows that counts as the trunk.
        least_step, least_tolerance: px, least difference to its surroundings, and least tolerance
            within it. thickness: 1/px, of a body; times the squared disparity it is in px.

    Returns:
        The trunk's disparity, px, and its left edge, middle and right edge, medians (4,). Number
        of cells per kind of evidence (4,). Number of cells around it that are farther, at its
        depth, and all (3,). Whether its true extent to the left and to the right is hidden (2,).
    """
    w = mask.shape[1]
    height, width = box[3] - box[1], box[2] - box[0]
    trunk = max(1, math.floor(trunk_share * height + 0.5))
    depths, evident = np.empty(height * width), np.zeros(4, np.int64)
    # First column, mean and last one of each row of the trunk.
    columns, row = np.empty(3 * trunk), np.zeros(trunk, np.int64)
    count = rows = 0
    for r in range(box[1], box[3]):
        first, last, total, number = 0, 0, 0, 0
        for c in range(box[0], box[2]):
            if not mask[r, c]:
                continue
            evident[evidence[r, c]] += 1
            if r < box[1] + trunk:
                depths[count] = disparity[r, c]
                count += 1
                first, last = c if number == 0 else first, c
                number += 1
                total += c - box[0]
        if number > 0:
            columns[rows], columns[2 * trunk + rows], row[rows] = first, last, r
            columns[trunk + rows] = total / number + box[0]
            rows += 1
    out = np.empty(4)
    for k in range(4):
        if k > 0:
            count = rows
            for i in range(rows):
                depths[i] = columns[(k - 1) * trunk + i]
        out[k] = median(depths[:count])
    d = out[0]
    tolerance = max(least_tolerance, d * d * thickness)
    cut_left = cut_right = False
    for side in range(2):
        # Left of this column the right camera does not see this depth.
        least = int(d / reduction) + 2 if side == 0 else 0
        hidden = 0
        for k in range(rows):
            column = int(columns[2 * side * trunk + k]) + (_BESIDE if side == 1 else -_BESIDE)
            at = min(max(column, 0), w - 1)
            beside = disparity[row[k], at]
            # Arrived cells at the same depth may belong to it.
            goes_on = standing[row[k], at] and evidence[row[k], at] == ARRIVED
            goes_on = goes_on and beside > np.float32(d - tolerance / 2)
            nearer = beside > np.float32(d + tolerance)
            hidden += column < least or column >= w - 1 or nearer or goes_on
        if side == 0:
            cut_left = hidden / rows > _CUT_SHARE
        else:
            cut_right = hidden / rows > _CUT_SHARE
    border = np.zeros(3, np.int64)
    _border(mask, disparity, standing, box, np.float32(max(least_step, tolerance / 2)), border)
    return out, evident, border, (cut_left, cut_right)
