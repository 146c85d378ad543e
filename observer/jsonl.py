"""Observations as JSON lines, as the command line writes and ``evaluate`` reads them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from observer.geometry import Pose
from observer.types import Observation, Obstacle, Unseen

# Values of ``Status``, ``TrackState`` and ``MotionState``, as JSON has them.
StatusWord = Literal["ok", "degraded", "lost"]
StateWord = Literal["tentative", "confirmed", "coasting"]
MotionWord = Literal["moving", "in_place", "stopped"]


class PoseEntry(TypedDict):
    """``T_world_camera``."""

    position: list[float]
    orientation_wxyz: list[float]


class ObstacleEntry(TypedDict):
    """One obstacle, SI units; world quantities are null where the pose is unknown.

    ``velocity_time``: the instant on the source's clock to which the speed belongs. ``bearing``:
    positive to the right. ``closing_speed``: positive while the range shrinks. ``why``: one
    sentence of why it counts as dynamic.
    """

    id: int
    state: StateWord
    motion: MotionWord
    position: list[float] | None
    velocity: list[float] | None
    speed: float
    speed_std: float | None
    position_cov: list[list[float]] | None
    velocity_cov: list[list[float]] | None
    velocity_time: float
    size: list[float]
    orientation_wxyz: list[float] | None
    range: float
    bearing: float
    closing_speed: float | None
    points: int
    significance: float
    box_px: list[float]
    why: str


class OutlinedEntry(ObstacleEntry):
    """One obstacle with its ``silhouette`` in the rectified left image.

    A list of closed polygons, each a list of ``[u, v]`` in whole pixels; null where the obstacle is
    not seen in this frame or known by points alone.
    """

    silhouette: list[list[list[int]]] | None


class UnseenEntry(TypedDict):
    """Parts of an image where motion could not be noticed; see ``observer.types.Unseen``."""

    share: float
    causes: dict[str, float]
    cell_px: int
    rows: list[str]


class FrameLine(TypedDict):
    """One observation without its obstacles; ``time`` is the source's clock."""

    frame: int
    time: float
    segment: int
    status: StatusWord
    reasons: list[str]
    parameters_revision: int
    pose: PoseEntry | None
    unseen: UnseenEntry | None
    timings_ms: dict[str, float]


class ObservationLine(FrameLine):
    """One observation, as it is written and recorded."""

    obstacles: list[OutlinedEntry]


def observation_line(observation: Observation, *, tentative: bool = False) -> ObservationLine:
    """Return the plain dictionary of an observation's JSON line; unknown is None, never NaN.

    Args:
        tentative: include obstacles that are not confirmed yet.
    """
    pose = observation.T_world_camera
    return {
        "frame": observation.frame,
        "time": observation.time,
        "segment": observation.segment,
        "status": _word(observation.status),
        "reasons": list(observation.reasons),
        "parameters_revision": observation.parameters_revision,
        "pose": None
        if pose is None
        else {
            "position": pose.translation.tolist(),
            "orientation_wxyz": pose.quaternion_wxyz.tolist(),
        },
        "obstacles": [
            obstacle_entry(o)
            for o in (observation.obstacles if tentative else observation.reported)
        ],
        "unseen": None if observation.unseen is None else _unseen_entry(observation.unseen),
        "timings_ms": {name: round(ms, 3) for name, ms in observation.timings_ms.items()},
    }


def line_pose(line: Mapping[str, Any]) -> Pose | None:
    """``T_world_camera`` of a JSON line; None where the pose was unknown.

    Raises:
        KeyError, TypeError, ValueError: the line was not made by ``observation_line``.
    """
    pose = line["pose"]
    if pose is None:
        return None
    return Pose.from_quaternion(pose["orientation_wxyz"], pose["position"])


def obstacle_entry(obstacle: Obstacle) -> OutlinedEntry:
    """Return one obstacle of a JSON line."""
    return {
        "id": obstacle.id,
        "state": _word(obstacle.state),
        "motion": _word(obstacle.motion),
        "position": _listed(obstacle.position),
        "velocity": _listed(obstacle.velocity),
        "speed": obstacle.speed,
        "speed_std": obstacle.speed_std,
        "position_cov": _listed(obstacle.position_cov),
        "velocity_cov": _listed(obstacle.velocity_cov),
        "velocity_time": obstacle.velocity_time,
        "size": _listed(obstacle.size),
        "orientation_wxyz": _listed(obstacle.orientation_wxyz),
        "range": obstacle.range,
        "bearing": obstacle.bearing,
        "closing_speed": obstacle.closing_speed,
        "points": obstacle.points,
        "significance": obstacle.significance,
        "box_px": list(obstacle.box_px),
        "why": obstacle.reason,
        "silhouette": None
        if obstacle.silhouette is None
        else [np.rint(polygon).astype(int).tolist() for polygon in obstacle.silhouette],
    }


def _unseen_entry(unseen: Unseen) -> UnseenEntry:
    return {
        "share": unseen.share,
        "causes": dict(unseen.causes),
        "cell_px": unseen.cell_px,
        "rows": list(unseen.rows),
    }


def _word(member: Enum) -> Any:
    return member.value


def _listed(array: NDArray[np.float64] | None) -> Any:
    return None if array is None else array.tolist()
