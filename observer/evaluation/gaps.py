"""Gaps in a curve where nothing was known for a while."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array

# No curve is drawn over a stretch this many times its usual step, in reports or on the page.
GAP_STEPS = 3.0


def broken(times: Float64Array, *values: Float64Array) -> tuple[Float64Array, ...]:
    """Return times (N + G,), s, and values (N + G,), NaN in each of G gaps: no line crosses them.

    Args:
        times: (N,) ascending. values: (N,) each.
    """
    if len(times) < 3:
        return (times, *values)
    steps = np.diff(times)
    gaps = np.flatnonzero(steps > GAP_STEPS * np.median(steps)) + 1
    between = (times[gaps - 1] + times[gaps]) / 2
    return (
        np.insert(times, gaps, between),
        *(np.insert(np.asarray(each, np.float64), gaps, np.nan) for each in values),
    )
