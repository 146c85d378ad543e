"""Check of the images over time: light or exposure that flickers.

A turning camera sees darker and lighter places too, but not back and forth several times a second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

# Seconds over which reversals of the brightness are counted.
FLICKER_WINDOW_S = 1.0
# It flickers if the brightness reverses this often, up and down together, by this factor or more.
_LEAST_TURNS = 3
_LEAST_SWING = math.log(1.15)


def flicker_reason(levels: Sequence[float]) -> str | None:
    """Return what is wrong with the brightness over time; None if it does not flicker.

    Args:
        levels: logarithms of the mean grey level of successive images, ``FLICKER_WINDOW_S`` long.
    """
    if _turns(levels) < _LEAST_TURNS:
        return None
    swing = max(levels) - min(levels)
    return (
        f"the image flickers: its brightness changes by {100 * math.expm1(swing):.0f} % within a "
        "second; set a fixed exposure, or match it to the mains frequency of the lights"
    )


def _turns(levels: Sequence[float]) -> int:
    """Return how often the levels reversed by ``_LEAST_SWING`` or more."""
    turns = 0
    rising: bool | None = None
    # Extremes since the last reversal.
    low = high = levels[0]
    for level in levels:
        low, high = min(low, level), max(high, level)
        if rising is not False and high - level >= _LEAST_SWING:
            turns += rising is True
            rising, low = False, level
        elif rising is not True and level - low >= _LEAST_SWING:
            turns += rising is False
            rising, high = True, level
    return turns
