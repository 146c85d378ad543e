"""Cells that look different from a moment ago."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import (
    BYTES1,
    SINGLE,
    SINGLES1,
    SINGLES2,
    WHOLE,
    WHOLES1,
    Bytes,
    Flags,
    Indices,
    Singles,
    kernel,
)
from observer.kernels.reprojection import cell_there

# Grey levels: from the first upwards and the second downwards a camera may have clipped the value.
_SATURATED, BLACK = 250, 2


@kernel(
    WHOLES1, SINGLES1, SINGLES1, SINGLES1, SINGLES2, SINGLES1, SINGLES1, WHOLE, WHOLE, SINGLES1,
    SINGLE, SINGLE,
)  # fmt: skip
def seen_again(
    asked: Indices,
    disparity: Singles,
    x: Singles,
    y: Singles,
    R: Singles,
    t: Singles,
    lens: Singles,
    height: int,
    width: int,
    nearest: Singles,
    slack: np.float32,
    slack_share: np.float32,
) -> tuple[Indices, Indices, Flags]:
    """Find where cells of one frame were seen in another.

    Args:
        asked: (N,) indices of the cells. disparity: (h w,) px, of the frame.
        x, y: (h w,) of the cells' rays. R, t, lens, height, width: as of ``cell_there``.
        nearest: (h w,) px, largest around each cell of the other frame.
        slack: px, and slack_share: of the disparity, tolerance within which disparities are equal.

    Returns:
        Indices (M,) of the cells that were in view and not hidden, and those of the cells (M,) that
        showed them; which of them (M,) were as near then, and so most likely showed the same.
    """
    now, then = np.empty(len(asked), np.int64), np.empty(len(asked), np.int64)
    alike = np.empty(len(asked), np.bool_)
    count = 0
    for k in range(len(asked)):
        i = asked[k]
        at, d = cell_there(x[i], y[i], disparity[i], R, t, lens, height, width)
        most = slack + slack_share * d
        if at >= 0 and nearest[at] - d <= most:
            now[count], then[count] = i, at
            alike[count] = d - nearest[at] <= most
            count += 1
    return now[:count], then[:count], alike[:count]


@kernel(WHOLES1, WHOLES1, BYTES1, BYTES1, BYTES1, SINGLE, SINGLE)
def differs(
    now: Indices,
    then: Indices,
    grey: Bytes,
    darkest: Bytes,
    brightest: Bytes,
    gain: np.float32,
    limit: np.float32,
) -> Flags:
    """Return which of M cells are brighter or darker than their whole neighbourhood was before.

    Cells that are or were clipped at either end may be unchanged, and do not count.

    Args:
        now: (M,) indices of the cells, and then: (M,) of those that showed them before.
        grey: (h w,) of the frame. darkest, brightest: (h w,) around each cell of the other.
        gain: factor on the other frame's grey levels. limit: grey levels, exceeds noise.
    """
    out = np.empty(len(now), np.bool_)
    for k in range(len(now)):
        i, at = now[k], then[k]
        here = grey[i]
        low, high = darkest[at], brightest[at]
        shown = max(here, high) < _SATURATED and min(here, low) > BLACK
        level = np.float32(here)
        other = level - gain * np.float32(high) > limit or gain * np.float32(low) - level > limit
        out[k] = shown and other
    return out
