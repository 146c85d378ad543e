"""Check of the images over time: light or exposure that flickers.

A camera that turns sees darker and lighter places too, but not to and fro several times a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

# Seconds over which turns of the brightness are counted.
FLICKER_WINDOW_S = 1.0
# It flickers if the brightness turns so often by this factor or more, up and down together.
_LEAST_TURNS = 3
_LEAST_SWING = math.log(1.15)


def flicker_reason(levels: Sequence[float]) -> str | None:
    """Return what is wrong with the brightness over time; None if it does not flicker.

    Args:
        levels: logarithms of the mean grey level of successive images, ``FLICKER_WINDOW_S`` long.
    """
    turns, swing = _turns(levels)
    if turns < _LEAST_TURNS:
        return None
    return (
        f"the exposure flickers: the brightness changes by {100 * math.expm1(swing):.0f} % and "
        f"back within a second; fix the exposure, or match it to the lamps' mains frequency"
    )


def _turns(levels: Sequence[float]) -> tuple[int, float]:
    """Return how often the levels turned by ``_LEAST_SWING`` or more, and the largest swing."""
    turns, largest = 0, 0.0
    low = high = extreme = levels[0]
    rising: bool | None = None
    for level in levels[1:]:
        low, high = min(low, level), max(high, level)
        if rising is None:
            if high - low >= _LEAST_SWING:
                rising, extreme, largest = level == high, level, high - low
            continue
        ahead = level - extreme if rising else extreme - level
        if ahead >= 0:
            extreme, largest = level, max(largest, high - low)
        elif -ahead >= _LEAST_SWING:
            turns, rising, extreme = turns + 1, not rising, level
    return turns, max(largest, high - low) if rising is not None else 0.0
