"""Results of the rig's estimators: numbers with their uncertainty, or why there are none."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array


@dataclass(frozen=True)
class Estimated:
    """A number with one standard deviation, in the same unit (SI)."""

    value: float
    sigma: float

    @property
    def degrees(self) -> Estimated:
        """An angle in radians, for people's eyes."""
        return Estimated(math.degrees(self.value), math.degrees(self.sigma))


@dataclass(frozen=True)
class Refused:
    """Refusal: nothing can be estimated.

    Attributes:
        sentence: what is wrong, and what would be right.
    """

    sentence: str


def numeric_jacobian(
    function: Callable[[Float64Array], Float64Array], at: Float64Array, steps: Sequence[float]
) -> Float64Array:
    """(M, N) derivative of a function (N,) -> (M,), by central differences of these steps."""
    columns = []
    for k, step in enumerate(steps):
        away = np.zeros(len(at))
        away[k] = step
        columns.append((function(at + away) - function(at - away)) / (2 * step))
    return np.stack(columns, axis=1)
