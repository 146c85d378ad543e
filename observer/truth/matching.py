"""Matching of reported obstacles and true bodies for comparison; never an input of the method."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import NotRequired

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment
from typing_extensions import TypedDict

from observer.geometry import Pose
from observer.truth.contract import TrueBody, Truth
from observer.truth.sampled import TruthSample
from observer.types import Observation

# An obstacle further than this from a body's surface (its half length) is not matched to it.
GATE_M = 1.0


class TrueBodyEntry(TypedDict):
    """Ground truth of one body, in the world frame of the observation.

    ``time``: only of motion capture, the instant on the source's clock at which it was measured,
    up to 0.1 s before the frame. ``track_id``: the reported obstacle it was matched to.
    """

    id: int
    name: str
    role: str
    position: list[float]
    velocity: list[float]
    speed: float
    size: list[float]
    yaw: float
    visible: float | None
    commanded_speed: float | None
    track_id: int | None
    time: NotRequired[float]


class SegmentWorlds:
    """Alignment of each segment's world with that of a truth.

    Truth's world is the camera frame at the source's first frame; a segment's is the camera frame
    at its first valid pose. The two are aligned once per segment, at that pose, so that later drift
    stays visible. Where the camera's true pose is unknown, only a first segment that begins with
    frame 0 can be aligned: its world is the truth's.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._T_world_truth: dict[int, Pose] = {}

    def at(self, segment: int, frame: int, time: float, pose: Pose | None) -> Pose | None:
        """Return ``T_world_truth`` of a segment at its next frame; None while it is unknown.

        Args:
            time: of the frame, on the truth's clock. pose: ``T_world_camera`` at it.
        """
        known = self._T_world_truth.get(segment)
        if known is not None or pose is None:
            return known
        T_truth_camera = self._truth.camera_pose(time)
        if T_truth_camera is not None:
            self._T_world_truth[segment] = pose @ T_truth_camera.inverse()
        elif segment == 0 and frame == 0:
            self._T_world_truth[segment] = Pose.identity()
        return self._T_world_truth.get(segment)


class TruthMatcher:
    """Transforms truth into the observation's world frame and matches it with reported obstacles.

    ``SegmentWorlds`` says how the two world frames are aligned.

    Attributes:
        took_s: seconds that computing the newest true bodies took; 0 before the first.
    """

    def __init__(self, truth: Truth) -> None:
        self.took_s = 0.0
        self._truth = truth
        self._worlds = SegmentWorlds(truth)
        self._newest: tuple[float, tuple[TrueBody, ...]] | None = None

    def match(self, observation: Observation, source_time: float) -> list[TrueBodyEntry]:
        """Return an entry per true body at ``source_time``, as in ``ObservationEvent.truth``.

        The list is empty as long as the two world frames cannot be aligned.
        """
        T_world_truth = self._worlds.at(
            observation.segment, observation.frame, source_time, observation.T_world_camera
        )
        if T_world_truth is None:
            return []
        bodies = self._bodies(source_time)
        obstacles = [body for body in bodies if body.role == "obstacle"]
        positions = {obstacle.id: obstacle.position for obstacle in observation.reported}
        tracks = assign(obstacles, T_world_truth, positions)
        return [entry(body, T_world_truth, tracks.get(body.id)) for body in bodies]

    def prepare(self, source_time: float) -> None:
        """Compute the true bodies at ``source_time``, which ``match`` and ``sample`` then reuse."""
        self._bodies(source_time)

    def sample(self, frame: int, time: float, source_time: float) -> TruthSample:
        """Return the truth at ``source_time``, in the truth's own world, for a recording.

        Args:
            frame, time: of the frame as it was observed.
        """
        pose = self._truth.camera_pose(source_time)
        return TruthSample(frame, time, self._bodies(source_time), pose)

    def _bodies(self, source_time: float) -> tuple[TrueBody, ...]:
        # Called repeatedly per frame, and a simulator has to cast rays to find what is visible.
        if self._newest is None or self._newest[0] != source_time:
            began = time.perf_counter()
            self._newest = source_time, self._truth.bodies(source_time)
            self.took_s = time.perf_counter() - began
        return self._newest[1]


def assign(
    bodies: list[TrueBody], T_world_truth: Pose, positions: Mapping[int, ArrayLike | None]
) -> dict[int, int]:
    """Assign track ids to body ids at the least total distance within the gate.

    Args:
        T_world_truth: from the bodies' world to that of the obstacles.
        positions: (3,) metres, of each track; None where unknown.
    """
    ids = [track for track, position in positions.items() if position is not None]
    if not bodies or not ids:
        return {}
    true = T_world_truth.apply([body.position for body in bodies])
    seen = np.array([positions[track] for track in ids])
    distance = np.linalg.norm(true[:, None] - seen[None], axis=2)
    gate = np.array([GATE_M + float(body.size[0]) / 2 for body in bodies])[:, None]
    cost = np.where(distance <= gate, distance, 1e6)
    rows, columns = linear_sum_assignment(cost)
    return {
        bodies[row].id: ids[column]
        for row, column in zip(rows, columns, strict=True)
        if cost[row, column] < 1e6
    }


def entry(body: TrueBody, T_world_truth: Pose, track_id: int | None) -> TrueBodyEntry:
    """Return an entry of ``ObservationEvent.truth``."""
    ahead = T_world_truth.rotate([np.sin(body.yaw), 0.0, np.cos(body.yaw)])
    return {
        "id": body.id,
        "name": body.name,
        "role": body.role,
        "position": T_world_truth.apply(body.position).tolist(),
        "velocity": T_world_truth.rotate(body.velocity).tolist(),
        "speed": body.speed,
        "size": body.size.tolist(),
        "yaw": float(np.arctan2(ahead[0], ahead[2])),
        "visible": body.visible,
        "commanded_speed": body.commanded_speed,
        "track_id": track_id,
    }
