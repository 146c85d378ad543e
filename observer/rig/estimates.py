"""Results of the rig's estimators: numbers with their uncertainty, or why there are none."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimated:
    """A number with one standard deviation, in the same unit (SI)."""

    value: float
    sigma: float

    @property
    def degrees(self) -> Estimated:
        """This angle, given in radians, converted to degrees."""
        return Estimated(math.degrees(self.value), math.degrees(self.sigma))


@dataclass(frozen=True)
class Refused:
    """Refusal: nothing can be estimated.

    Attributes:
        sentence: what is wrong, and what would be right.
    """

    sentence: str
