"""Plan of each frame: the scene from above, in a level plane of the segment's world."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from app.contract.frame_plan import SIGMAS_95_2D, FramePlan, PlanBody, PlanMap, PlanObstacle
from app.contract.robots import GoalNow
from observer.geometry import Float64Array, Pose
from observer.jsonl import ObservationLine, line_pose
from observer.mount import level_pose
from observer.recording.local_maps import maps_in_force
from observer.recording.payloads import RecordedFrame
from observer.recording.reader import Recording
from observer.recording.run_time import RunTime
from observer.truth.contract import Truth
from observer.truth.matching import SegmentWorlds

_DIGITS = 3


class Plans:
    """Maker of the plans of a run's frames, which must come in order.

    Args:
        truth: ground truth on the run's clock; its world is aligned with each segment's by
            ``SegmentWorlds``.
    """

    def __init__(self, recording: Recording, truth: Truth | None) -> None:
        mount = recording.facts.camera_mount()
        self._T_level_world = level_pose(mount)
        self._T_camera_base = None if mount is None else mount.T_base_camera.inverse()
        self._truth = truth
        self._clock = RunTime()
        self._segment = recording.facts.segment
        self._worlds = None if truth is None else SegmentWorlds(truth)

    def of(
        self, frame: RecordedFrame, line: ObservationLine | None, goal: GoalNow | None = None
    ) -> FramePlan:
        """Return the plan of the next frame.

        Args:
            line: JSON line of its observation; None if the frame was not observed.
            goal: goal of the observer at that time; None if it had none.
        """
        time = self._clock.add_recorded(frame)
        if line is None:
            return FramePlan(time, self._segment, None, [], [])
        self._segment = line["segment"]
        pose = line_pose(line)
        way = self._way(pose, goal)
        return FramePlan(
            time=time,
            segment=self._segment,
            camera=None if pose is None else self._camera(pose),
            obstacles=list(self._obstacles(line)),
            truth=list(self._bodies(frame.index, time, pose)),
            goal=way[0] if way else None,
            path=way[1:],
        )

    def _way(self, pose: Pose | None, goal: GoalNow | None) -> list[list[float]]:
        """Return the goal and the planned path to it; empty unless the robot drives to it."""
        if pose is None or self._T_camera_base is None or goal is None or goal.place is None:
            return []
        if goal.state != "driving":
            return []
        T_level_base = self._T_level_world @ pose @ self._T_camera_base
        places = np.array([(*place, 0.0) for place in (goal.place, *goal.path)])
        return [_flat(place) for place in T_level_base.apply(places)]

    def _camera(self, pose: Pose) -> list[float]:
        T_level_camera = self._T_level_world @ pose
        ahead = T_level_camera.rotate([0.0, 0.0, 1.0])
        return [*_flat(T_level_camera.translation), _angle(ahead)]

    def _obstacles(self, line: ObservationLine) -> Iterator[PlanObstacle]:
        for entry in line["obstacles"]:
            if entry["position"] is None:
                continue
            velocity, covariance = entry["velocity"], entry["position_cov"]
            yield PlanObstacle(
                id=entry["id"],
                state=entry["state"],
                motion=entry["motion"],
                at=_flat(self._T_level_world.apply(entry["position"])),
                velocity=None if velocity is None else self._rotated(velocity),
                ellipse=None if covariance is None else self._ellipse(np.array(covariance)),
            )

    def _ellipse(self, covariance: Float64Array) -> list[float] | None:
        R = self._T_level_world.rotation
        level = (R @ covariance @ R.T)[:2, :2]
        if not np.isfinite(level).all():
            return None
        values, vectors = np.linalg.eigh(level)
        half = SIGMAS_95_2D * np.sqrt(np.maximum(values[::-1], 0.0))
        return [*_flat(half), _angle(vectors[:, 1])]

    def _bodies(self, index: int, time: float, pose: Pose | None) -> Iterator[PlanBody]:
        if self._truth is None or self._worlds is None:
            return
        T_world_truth = self._worlds.at(self._segment, index, time, pose)
        if T_world_truth is None:
            return
        for body in self._truth.bodies(time):
            if body.role != "observer":
                at = T_world_truth.apply(body.position)
                velocity = self._rotated(T_world_truth.rotate(body.velocity))
                yield PlanBody(body.name, _flat(self._T_level_world.apply(at)), velocity)

    def _rotated(self, vector: Any) -> list[float]:
        return _flat(self._T_level_world.rotate(vector))


def plan_maps(recording: Recording) -> list[PlanMap]:
    """Return the local maps of a run whose pose is known, in order."""
    T_level_world = level_pose(recording.facts.camera_mount())
    found = []
    for one in maps_in_force(recording):
        T_world_base = one.T_world_base.get(one.positions.start)
        if T_world_base is None:
            continue
        T_level_corner = T_level_world @ one.map.placed(T_world_base)
        found.append(
            PlanMap(
                first=one.positions.start,
                last=one.positions.stop - 1,
                corner=[
                    *_flat(T_level_corner.translation),
                    _angle(T_level_corner.rotate([1.0, 0.0, 0.0])),
                ],
                cell_m=one.map.cell_m,
                size=one.map.size,
                runs=one.map.runs,
            )
        )
    return found


def _flat(vector: Float64Array) -> list[float]:
    # Adding 0.0 turns -0.0 into 0.0.
    return [round(float(value), _DIGITS) + 0.0 for value in vector[:2]]


def _angle(vector: Float64Array) -> float:
    return round(math.atan2(float(vector[1]), float(vector[0])), _DIGITS)
