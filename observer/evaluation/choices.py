"""Choices for an evaluation: its scale, its number of frames, and the figures that rank a sweep.

The command line's help imports it, so it imports nothing slow.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Literal

from observer.truth.counting import MOVING_MPS

GATE_M = 0.5
ROAD_GATE_M = 3.0
# Frames after which an endless scenario is stopped by default.
DEFAULT_MAX_FRAMES = 300
# Prefix of a sweep's crowd sources, and how often each is driven through.
CROWD = "crowd:"
DEFAULT_RUNS = 20

ObservingFigure = Literal[
    "mota",
    "recall",
    "false_per_100_frames",
    "speed_rmse_mps",
    "velocity_rmse_mps",
    "centre_rmse_m",
    "delay_median_s",
]
DrivingFigure = Literal["time_ratio", "contacts_per_m", "ahead_per_m", "reached"]
RankedBy = Literal[ObservingFigure, DrivingFigure]


@dataclass(frozen=True)
class Scale:
    """Scale on which a place is judged: a room or a road.

    Attributes:
        gate_m: highest distance of an instance from its body.
        range_limits_m, speed_limits_mps: limits of the classes, ascending, the last one infinite.
    """

    name: str
    gate_m: float
    range_limits_m: tuple[float, ...]
    speed_limits_mps: tuple[float, ...]


LAB = Scale("lab", GATE_M, (0.0, 2.0, 3.0, 4.0, inf), (MOVING_MPS, 0.2, 0.4, 0.7, inf))
ROAD = Scale("road", ROAD_GATE_M, (0.0, 10.0, 20.0, 30.0, inf), (0.0, 5.0, 10.0, inf))
