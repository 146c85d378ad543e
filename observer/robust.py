"""Robust statistics that need no library."""

from __future__ import annotations

from typing import Final

# Of normally distributed values the median absolute deviation, times this, is the standard
# deviation: 1 / the 75 % quantile of the normal distribution.
MAD_TO_SIGMA: Final = 1.4826
