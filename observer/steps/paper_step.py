"""Data of one step of the paper, and functions that several steps share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.steps.formulas import Formula
from observer.steps.pair import ObservedPair


@dataclass(frozen=True)
class Number:
    """A numeric result of a step.

    Attributes:
        name: shown to people. value: None if unknown. digits: decimals worth showing.
    """

    name: str
    value: float | None
    unit: str = ""
    digits: int = 0


@dataclass(frozen=True)
class PaperStep:
    """One step of the method on one pair.

    Attributes:
        number: from 1 to 9. key: for files and code. title, text: shown to people.
        caption: what the colours in its picture mean.
        formula: with the names that the text uses.
        numbers: of this pair.
        parameters: dotted names of the parameters that affect this step.
        missing: why it has no result in this frame; None if it has one.
    """

    number: int
    key: str
    title: str
    text: str
    caption: str
    formula: Formula
    numbers: tuple[Number, ...]
    parameters: tuple[str, ...]
    missing: str | None = None


def lost(pair: ObservedPair) -> str | None:
    """Return why the pair has no results from the ego-motion on; None if it has."""
    ego = pair.trace["ego_motion"]
    if ego.homography is not None:
        return None
    why = "; ".join(ego.reasons)
    return f"The ego-motion is lost in this frame: {why}. Choose another frame or threshold."


def percent(count: int, total: int) -> float | None:
    """Return a share in percent; None if the total is 0."""
    return 100 * count / total if total else None


def known_median(values: Float64Array) -> float | None:
    """Return the median of values (N,); None without any."""
    return float(np.median(values)) if len(values) else None
