"""The chi-square distribution, by the functions of which ``scipy.stats`` makes it.

Importing ``scipy.stats`` takes a third of the time in which an engine starts.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri, gammaincinv


def quantile(probability: float, df: int) -> float:
    """The value below which a share ``probability`` lies, for ``df`` degrees of freedom."""
    return float(2 * gammaincinv(df / 2, probability))


def upper_quantile(probability: float, df: int) -> float:
    """The value above which a share ``probability`` lies; exact also for very small shares."""
    return float(chdtri(df, probability))


def log_share_above(value: float, df: int) -> float:
    """Natural logarithm of the share that lies above; -inf where that is too small a number."""
    with np.errstate(divide="ignore"):
        return float(np.log(chdtrc(df, value)))
