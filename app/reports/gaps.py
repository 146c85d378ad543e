"""Where a curve ends because nothing was known for a while."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array

# A curve is not drawn over a stretch this many times its usual step.
_GAP_STEPS = 3.0


def broken(times: Float64Array, *values: Float64Array) -> tuple[Float64Array, ...]:
    """The same with a NaN in every gap, so that no line is drawn over it."""
    if len(times) < 3:
        return (times, *values)
    steps = np.diff(times)
    gaps = np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1
    between = (times[gaps - 1] + times[gaps]) / 2
    return (
        np.insert(times, gaps, between),
        *(np.insert(np.asarray(each, np.float64), gaps, np.nan) for each in values),
    )
