"""Explanation of why one pixel is classified as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means


@dataclass(frozen=True)
class PixelObstacle:
    id: int
    reported: Annotated[bool, means("Whether it has been seen often enough to be reported.")]
    why: Annotated[str, means("Why it counts as dynamic.")]


@dataclass(frozen=True)
class Pixel:
    """Reason why a pixel of the newest observed frame is classified as it is."""

    frame: int
    segment: int
    u: float
    v: float
    verdict: Literal[
        "dynamic", "static", "undecided", "too_far", "too_few_features", "ego_motion_lost"
    ]
    sentence: str
    numbers: Annotated[
        Mapping[str, float | None],
        means("Numbers behind the answer; each name ends with the unit. null: unknown."),
    ]
    would_change: Annotated[str, means("The parameter and value that would change the answer.")]
    obstacle: Annotated[
        PixelObstacle | None, means("The obstacle to which a dynamic pixel belongs.")
    ]
