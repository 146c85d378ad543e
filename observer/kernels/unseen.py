"""Places where motion would go unnoticed, in cells smaller than a person; see the rigid method."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import (
    BYTES2,
    FLAGS1,
    FLAGS2,
    REAL,
    SINGLE,
    SINGLES2,
    WHOLE,
    WHOLES2,
    Bytes,
    Flags,
    Indices,
    Singles,
    kernel,
)

# Share of what is known around a plain region that must be static: along its whole border, and
# near the cell.
_STANDING_AROUND, _STANDING_NEARBY = 0.8, 0.5
# Share of a plain region's border that must be known to be static.
_KNOWN_BORDER = 0.25


@kernel(BYTES2, WHOLE)
def cell_means(values: Bytes, side: int) -> Singles:
    """Return the means (rows, columns) of values (h, w) over squares of ``side`` by ``side``.

    Where the last squares reach beyond the values, the border values are repeated.
    """
    h, w = values.shape
    rows, columns = (h + side - 1) // side, (w + side - 1) // side
    out = np.empty((rows, columns), np.float32)
    for r in range(rows):
        sums = np.zeros(w, np.int64)
        for k in range(side):
            line = values[min(r * side + k, h - 1)]
            for c in range(w):
                sums[c] += line[c]
        for c in range(columns):
            total = 0
            for k in range(side):
                total += sums[min(c * side + k, w - 1)]
            out[r, c] = total / (side * side)
    return out


@kernel(SINGLES2, SINGLES2, SINGLES2, SINGLES2, FLAGS1, SINGLE, SINGLE)
def told_by_points(
    known: Singles,
    stands: Singles,
    moves: Singles,
    px: Singles,
    dynamic: Flags,
    side_px: np.float32,
    least: np.float32,
) -> tuple[Singles, Singles, Singles]:
    """Add the points' evidence to the shares (rows, columns) known, static and moving.

    Args:
        px: (N, 2) of the points. dynamic: (N,) which of them move.
        side_px: of a cell. least: share that counts as known where there is a point.
    """
    rows, columns = known.shape
    # Bits: 1 where there is a static point, 2 where there is a moving one.
    told = np.zeros((rows, columns), np.uint8)
    for i in range(len(px)):
        c = min(max(int(px[i, 0] / side_px), 0), columns - 1)
        r = min(max(int(px[i, 1] / side_px), 0), rows - 1)
        told[r, c] |= 2 if dynamic[i] else 1
    seen, still, moving = known.copy(), stands.copy(), moves.copy()
    for r in range(rows):
        for c in range(columns):
            if told[r, c] == 0:
                continue
            seen[r, c] = max(known[r, c], least)
            if told[r, c] >= 2:
                moving[r, c] = seen[r, c]
            elif moves[r, c] == 0:
                still[r, c] = seen[r, c]
    return seen, still, moving


@kernel(WHOLES2, WHOLE, SINGLES2, SINGLES2, WHOLE, WHOLE)
def background(
    region: Indices,
    count: int,
    stands: Singles,
    moves: Singles,
    fit_rows: int,
    fit_columns: int,
) -> Flags:
    """Return the cells of plain regions around which nearly everything known is static.

    Args:
        region: (rows, columns) numbers of the regions, below ``count``; 0 elsewhere.
        stands, moves: (rows, columns) shares of the cells.
        fit_rows, fit_columns: of a person-sized window.
    """
    rows, columns = region.shape
    # Along each region's border: shares static and moving, and the number of cells.
    still, moving, border = np.zeros(count), np.zeros(count), np.zeros(count)
    for r in range(rows):
        for c in range(columns):
            if region[r, c] != 0:
                continue
            for side in range(4):
                y = r + (side - 2 if side % 2 == 1 else 0)
                x = c + (side - 1 if side % 2 == 0 else 0)
                if 0 <= y < rows and 0 <= x < columns:
                    number = region[y, x]
                    still[number] += stands[r, c]
                    moving[number] += moves[r, c]
                    border[number] += 1.0
    out = np.zeros((rows, columns), np.bool_)
    for r in range(rows):
        for c in range(columns):
            number = region[r, c]
            if number == 0 or not still[number] > 0.0:
                continue
            if still[number] < _KNOWN_BORDER * border[number]:
                continue
            if still[number] < _STANDING_AROUND * (still[number] + moving[number]):
                continue
            near = moved = 0.0
            for y in range(max(0, r - fit_rows // 2), min(rows, r + fit_rows // 2 + 1)):
                for x in range(
                    max(0, c - fit_columns // 2), min(columns, c + fit_columns // 2 + 1)
                ):
                    near += stands[y, x]
                    moved += moves[y, x]
            out[r, c] = near >= _STANDING_NEARBY * (near + moved)
    return out


@kernel(FLAGS2, WHOLE, WHOLE, REAL)
def fills(cells: Flags, fit_rows: int, fit_columns: int, share: float) -> bool:
    """Return whether the cells (rows, columns) fill this share of any window of the given size."""
    rows, columns = cells.shape
    high, wide = min(fit_rows, rows), min(fit_columns, columns)
    # Integral image of the cells.
    total = np.zeros((rows + 1, columns + 1), np.int64)
    most = 0
    for r in range(rows):
        here = 0
        for c in range(columns):
            here += cells[r, c]
            total[r + 1, c + 1] = total[r, c + 1] + here
            if r + 1 >= high and c + 1 >= wide:
                top, left = r + 1 - high, c + 1 - wide
                inside = total[r + 1, c + 1] - total[top, c + 1]
                most = max(most, inside - total[r + 1, left] + total[top, left])
    return bool(most >= share * high * wide)
