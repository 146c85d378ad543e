"""Reduced processing: what a computer too slow for its cameras leaves out, and in which order.

Fewer frames make every obstacle older and harder to follow, so the costliest work with the least
loss goes first: how often dense depth is computed, then how densely points are tracked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeVar

from observer.parameters.parameter_set import ParameterSet

_Set = TypeVar("_Set", bound=ParameterSet)


@dataclass(frozen=True)
class Reduction:
    """One step of reduced processing.

    Attributes:
        dense_rate_hz: maximum rate of dense depth. spacing_px: minimum spacing of tracked points.
        time_share: part of the full processing time that it takes, as measured over simulated
            scenes with robots and with people at 15 frames per second.
    """

    dense_rate_hz: float
    spacing_px: int
    time_share: float

    @property
    def words(self) -> str:
        """Describe it for people."""
        points = f", points every {self.spacing_px} px" if self.spacing_px else ""
        return f"dense depth at {self.dense_rate_hz:g} Hz{points}"


# From the mildest on; what is set to less already stays as it is.
REDUCTIONS: Final = (
    Reduction(dense_rate_hz=8.0, spacing_px=0, time_share=0.79),
    Reduction(dense_rate_hz=4.0, spacing_px=0, time_share=0.67),
    Reduction(dense_rate_hz=4.0, spacing_px=25, time_share=0.59),
    Reduction(dense_rate_hz=2.0, spacing_px=36, time_share=0.48),
)


def reductions(model: str) -> tuple[Reduction, ...]:
    """Return the reductions of a method, from the mildest on; none for methods that have none.

    Args:
        model: the value of ``ego_motion.model``.
    """
    return REDUCTIONS if model == "rigid" else ()


def reduced(parameters: _Set, reduction: Reduction | None) -> _Set:
    """Return the parameters that act while processing is reduced; the same without a reduction."""
    if reduction is None:
        return parameters
    given = parameters.flat()
    limits = {
        "dense.rate_hz": min(float(given["dense.rate_hz"]), reduction.dense_rate_hz),
        "klt_tracking.spacing_px": max(int(given["klt_tracking.spacing_px"]), reduction.spacing_px),
    }
    return parameters.changed(limits)
