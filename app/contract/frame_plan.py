"""The scene of one frame from above, as it is drawn to scale beside the frame's image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means

# Half axes of a normal distribution's 95 % ellipse in two dimensions, in standard deviations.
SIGMAS_95_2D = 2.448

_AT = "Metres ahead of and to the left of the camera's place at the segment's beginning."


@dataclass(frozen=True)
class PlanObstacle:
    id: int
    state: Literal["tentative", "confirmed", "coasting"]
    motion: Literal["moving", "in_place", "stopped"]
    at: Annotated[Sequence[float], means(_AT)]
    velocity: Annotated[Sequence[float] | None, means("m/s along the same axes.")]
    ellipse: Annotated[
        Sequence[float] | None,
        means(
            "95 % of where it may be: half axes, metres, and the first one's angle from ahead to "
            "the left, rad."
        ),
    ]


@dataclass(frozen=True)
class PlanBody:
    """A true obstacle."""

    name: str
    at: Annotated[Sequence[float], means(_AT)]
    velocity: Sequence[float]


@dataclass(frozen=True)
class PlanMap:
    """A local map by which the observer planned its way to a goal, as it was recorded."""

    first: Annotated[int, means("Position in the run of its frame, from 0.")]
    last: Annotated[int, means("And of the last frame at which it is the newest one.")]
    corner: Annotated[
        Sequence[float],
        means(f"{_AT} Of the corner of its cells; then the angle of their x from ahead, rad."),
    ]
    cell_m: float
    size: Annotated[int, means("Cells along each side, y within x.")]
    runs: Annotated[
        Sequence[int], means("How many in a row are unknown, free, blocked, unknown and so on.")
    ]


@dataclass(frozen=True)
class FramePlan:
    time: Annotated[float, means("On the run's clock, as in its chart, s.")]
    segment: int
    camera: Annotated[
        Sequence[float] | None,
        means(f"{_AT} Then the angle from ahead to the left, rad; None where it is lost."),
    ]
    obstacles: Sequence[PlanObstacle]
    truth: Sequence[PlanBody]
