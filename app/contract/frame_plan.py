"""The scene of one frame from above, as it is drawn to scale beside the frame's image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means
from observer.jsonl import MotionWord, StateWord

# Half axes of a normal distribution's 95 % ellipse in two dimensions, in standard deviations.
SIGMAS_95_2D = 2.448

_AT = "Metres ahead and to the left of the camera's position at the start of the segment."


@dataclass(frozen=True)
class PlanObstacle:
    id: int
    state: StateWord
    motion: MotionWord
    at: Annotated[Sequence[float], means(_AT)]
    velocity: Annotated[Sequence[float] | None, means("m/s, along the same axes.")]
    ellipse: Annotated[
        Sequence[float] | None,
        means(
            "95 % ellipse of its position: semi-axes, metres, and the angle of the first one from "
            "ahead to the left, rad."
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
    """A recorded local map that the observer used on its way to a goal."""

    first: Annotated[int, means("Position in the run of the frame it belongs to, from 0.")]
    last: Annotated[int, means("Position of the last frame for which it is the newest map.")]
    corner: Annotated[
        Sequence[float],
        means(f"The grid's corner: {_AT} Then the angle of the grid's x from ahead, rad."),
    ]
    cell_m: float
    size: Annotated[int, means("Cells along each side, y within x.")]
    runs: Annotated[
        Sequence[int], means("Run lengths of the cells: unknown, free, blocked, unknown and so on.")
    ]


@dataclass(frozen=True)
class FramePlan:
    time: Annotated[float, means("On the run's clock, as in its chart, s.")]
    segment: int
    camera: Annotated[
        Sequence[float] | None,
        means(f"{_AT} Then the angle from ahead to the left, rad; null if lost."),
    ]
    obstacles: Sequence[PlanObstacle]
    truth: Sequence[PlanBody]
    goal: Annotated[Sequence[float] | None, means(f"Goal to which the observer drives: {_AT}")] = (
        None
    )
    path: Annotated[
        Sequence[Sequence[float]], means(f"Path planned for the next seconds: {_AT}")
    ] = ()
