"""Units that motion capture files name, as factors to metres, radians and seconds."""

from __future__ import annotations

import math

import numpy as np

from observer.geometry import Float64Array

LENGTHS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
ANGLES_RAD = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
TIMES_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

# Larger numbers are not real measurements, indoors or outdoors.
MOST_METRES = 1e8
MOST_RADIANS = 1e3
# Three thousand years; stamps count from 1970 at the earliest.
MOST_SECONDS = 1e11
# Stamps from 1970 on, as of the years 2001 to 2100, in seconds.
_EPOCH_S = (1e9, 4.1e9)
# Samples this far apart are noted: milliseconds taken for seconds often are.
LONG_STEP_S = 2.0
# No capture of moving bodies has half of its samples this far apart.
LONGEST_STEP_S = 100.0
# A higher rate is a mistake.
FASTEST_HZ = 100_000.0
# Three times the speed of sound; faster than anything that cameras see move.
FASTEST_MPS = 1e3
# No room is larger, and millimetres taken for metres soon exceed it.
ROOM_M = 100.0


def length_word(unit: str) -> str:
    """Return the unit as a word for people."""
    return {"m": "metres", "cm": "centimetres", "mm": "millimetres"}.get(unit, unit)


def time_unit(times: Float64Array) -> str:
    """Return the unit of times (N,) that are stated without one: seconds, unless they count from
    1970 in smaller units.
    """
    middle = float(np.nanmedian(times)) if np.isfinite(times).any() else 0.0
    first, last = _EPOCH_S
    return next((unit for unit, scale in TIMES_S.items() if first <= middle * scale <= last), "s")


def time_word(unit: str) -> str:
    """Return the unit as a word for people."""
    return {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}.get(unit, "seconds")


def too_far_for_a_room(shown: str) -> str:
    """Return the start of a note about a position beyond ``ROOM_M``.

    Args:
        shown: the distance with its unit.
    """
    return f"a body is {shown} from the origin, too far for a room"
