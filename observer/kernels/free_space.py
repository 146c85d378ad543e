"""Detects what entered space seen free before, and what is seen where something stood before."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import (
    SINGLE,
    SINGLES1,
    SINGLES2,
    WHOLE,
    WHOLES1,
    Bytes,
    Indices,
    Singles,
    kernel,
)
from observer.kernels.reprojection import cell_there

# Evidence of a cell.
UNKNOWN, STATIC, ARRIVED, UNCOVERED = 0, 1, 2, 3


@kernel(
    WHOLES1, SINGLES1, SINGLES1, SINGLES1, SINGLES2, SINGLES1, SINGLES1, WHOLE, WHOLE,
    SINGLES1, SINGLES1, SINGLES1, SINGLE, SINGLE,
)  # fmt: skip
def evidence_against(
    asked: Indices,
    disparity: Singles,
    x: Singles,
    y: Singles,
    R: Singles,
    t: Singles,
    lens: Singles,
    height: int,
    width: int,
    known: Singles,
    nearest: Singles,
    farthest: Singles,
    slack: np.float32,
    slack_share: np.float32,
) -> tuple[Bytes, Indices]:
    """Classify N cells of one frame by their evidence of motion since another.

    Args:
        asked: (N,) indices of the cells. disparity: (h w,) px, of the frame.
        x, y: (h w,) of the cells' rays. R, t, lens, height, width: as of ``cell_there``.
        known: (h w,) px, disparities of the other frame, not above 0 where unknown.
        nearest, farthest: (h w,) px, largest and least of them around each cell.
        slack: px, and slack_share: of the disparity, tolerance within which disparities are equal.

    Returns:
        Evidence (N,), and the indices (M,) of the cells for which it is ``UNKNOWN``.
    """
    out = np.empty(len(asked), np.uint8)
    left = np.empty(len(asked), np.int64)
    count = 0
    for k in range(len(asked)):
        i = asked[k]
        at, d = cell_there(x[i], y[i], disparity[i], R, t, lens, height, width)
        if at < 0 or not known[at] > 0:
            out[k] = UNKNOWN
            left[count] = i
            count += 1
            continue
        noise = slack + slack_share * d
        if d - farthest[at] < -noise:
            out[k] = UNCOVERED
        elif d - nearest[at] > noise:
            out[k] = ARRIVED
        else:
            out[k] = STATIC
    return out, left[:count]
