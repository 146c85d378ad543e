"""The 95 % interval, in which every uncertainty is shown to people.

Data files, REST and the library's results keep standard deviations; only texts and pictures for
people use this factor. The page takes it from here, see ``tools/packaging/page_facts.py``.
"""

from __future__ import annotations

SIGMAS_95 = 1.96
"""Half of a normal distribution's middle 95 %, in standard deviations."""


def half_95(std: float) -> float:
    """Return half of the 95 % interval of a value with this standard deviation, in its unit."""
    return SIGMAS_95 * std
