"""Findings in each frame of a run, as they are drawn over the frame's image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.frame_plan import FramePlan, PlanMap
from app.contract.robots import GoalNow
from app.contract.values import means
from observer.jsonl import MotionWord, StateWord, StatusWord

_BOX = "u0, v0, u1, v1 in the rectified left image, pixels."


@dataclass(frozen=True)
class FrameObstacle:
    id: int
    state: StateWord
    motion: MotionWord
    speed: Annotated[float, means("m/s.")]
    speed_std: float | None
    box_px: Annotated[Sequence[float], means(_BOX)]
    arrow_px: Annotated[
        Sequence[float] | None,
        means("From its centre to where it will be in one second; null if unknown."),
    ]
    silhouette: Annotated[
        Sequence[Sequence[Sequence[int]]] | None, means("Closed polygons; null if unknown.")
    ]
    false: Annotated[bool, means("Whether it is a false obstacle: no true obstacle moves near it.")]


@dataclass(frozen=True)
class FrameBody:
    """A true obstacle in sight."""

    name: str
    speed: Annotated[float, means("m/s.")]
    box_px: Annotated[Sequence[float], means(_BOX)]


@dataclass(frozen=True)
class FrameCounts:
    """Comparison with ground truth, from the run's first frame up to this one."""

    false: Annotated[int, means("False obstacles, summed over frames.")]
    found: Annotated[int, means("True moving obstacles that were found, summed over frames.")]
    missed: Annotated[int, means("True moving obstacles that were missed, summed over frames.")]
    velocity_rmse_mps: Annotated[
        float | None, means("Velocity error of those found; null before the first.")
    ]


@dataclass(frozen=True)
class FrameEntry:
    frame: Annotated[int, means("Its number on the source.")]
    time: Annotated[float, means("On the source's clock, s.")]
    status: StatusWord
    obstacles: Sequence[FrameObstacle]
    truth: Sequence[FrameBody]
    counts: Annotated[FrameCounts | None, means("null without ground truth.")]
    observed_ms: Annotated[float | None, means("Processing time of the method.")]
    plan: FramePlan
    goal: Annotated[
        GoalNow | None, means("Goal of the observer at that time; null if it had none.")
    ] = None


@dataclass(frozen=True)
class RunFrames:
    width: Annotated[int, means("Width of the rectified left image, pixels.")]
    height: int
    frames: Annotated[
        Sequence[FrameEntry],
        means("In order; the image of the first one is /runs/ID/frames/FIRST.jpg, and so on."),
    ]
    truth: Annotated[bool, means("Whether there is ground truth to compare with.")]
    observed_ms: Annotated[float | None, means("Median processing time of the method per frame.")]
    first: Annotated[int, means("Position in the run of the first of these frames, from 0.")] = 0
    every: Annotated[int, means("Distance in positions from each of these frames to the next.")] = 1
    count: Annotated[int, means("Number of frames of the run.")] = 0
    maps: Annotated[
        Sequence[PlanMap],
        means("Local maps that apply to any of these frames; empty if frames are skipped."),
    ] = ()
