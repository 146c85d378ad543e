"""The chi-square distribution, from the functions on which ``scipy.stats`` builds it.

Importing ``scipy.stats`` itself would take a third of an engine's start-up time.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri, gammaincinv


def quantile(probability: float, df: int) -> float:
    """Return the value below which a share ``probability`` lies, for ``df`` degrees of freedom."""
    return float(2 * gammaincinv(df / 2, probability))


def upper_quantile(probability: float, df: int) -> float:
    """Return the value above which a share ``probability`` lies; exact even for tiny shares."""
    return float(chdtri(df, probability))


def log_share_above(value: float, df: int) -> float:
    """Return the natural logarithm of the share above ``value``; -inf if the share underflows."""
    with np.errstate(divide="ignore"):
        return float(np.log(chdtrc(df, value)))
