"""Observations as JSON lines, the way the command line writes and ``evaluate`` reads them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

import numpy as np

from observer.geometry import Pose
from observer.types import Observation, Obstacle

# In the order of a line.
_OF_OBSTACLE = (
    *("id", "state", "motion", "position", "velocity", "speed", "speed_std", "position_cov"),
    *("velocity_cov", "velocity_time", "size", "orientation_wxyz", "range", "bearing"),
    *("closing_speed", "points", "significance", "box_px"),
)


def observation_line(observation: Observation, *, tentative: bool = False) -> dict[str, Any]:
    """Return the plain dictionary of an observation's JSON line; no NaN, unknown is None.

    Args:
        tentative: include obstacles that are not confirmed yet.
    """
    pose = observation.T_world_camera
    shown = observation.obstacles if tentative else observation.reported
    return {
        "frame": observation.frame,
        "time": observation.time,
        "segment": observation.segment,
        "status": observation.status.value,
        "reasons": list(observation.reasons),
        "parameters_revision": observation.parameters_revision,
        "pose": pose
        and {
            "position": pose.translation.tolist(),
            "orientation_wxyz": pose.quaternion_wxyz.tolist(),
        },
        "obstacles": [obstacle_entry(o) for o in shown],
        "timings_ms": {name: round(ms, 3) for name, ms in observation.timings_ms.items()},
    }


def line_pose(line: Mapping[str, Any]) -> Pose | None:
    """Return ``T_world_camera`` of a JSON line; None where the pose was unknown.

    Raises:
        KeyError, TypeError, ValueError: the line is not as ``observation_line`` makes it.
    """
    pose = line["pose"]
    if pose is None:
        return None
    return Pose.from_quaternion(pose["orientation_wxyz"], pose["position"])


def obstacle_entry(obstacle: Obstacle) -> dict[str, Any]:
    """Return one obstacle of a JSON line. World quantities are None where the pose is unknown."""
    entry = {name: _plain(getattr(obstacle, name)) for name in _OF_OBSTACLE}
    return entry | {"why": obstacle.reason}


def _plain(value: Any) -> Any:
    """Return a value as JSON has it."""
    match value:
        case np.ndarray():
            return value.tolist()
        case StrEnum():
            return value.value
        case tuple():
            return list(value)
    return value
