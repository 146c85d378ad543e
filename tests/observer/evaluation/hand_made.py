"""Runs whose right answer is known by hand: bodies on straight lines, and reports of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.evaluation.choices import GATE_M
from observer.evaluation.evaluate import Evaluation, summarise
from observer.evaluation.lines import checked_lines
from observer.evaluation.tally import tally
from observer.geometry import Pose
from observer.truth.contract import TrueBody, Truth

DT = 0.1
SIZE = np.array([0.45, 0.38, 0.3])


def evaluate(lines: list[dict[str, Any]], truth: Truth, gate_m: float = GATE_M) -> Evaluation:
    return summarise([tally(checked_lines(lines), truth, gate_m)])


class StraightTruth:
    """Bodies on straight lines, id -> (start, velocity), with the interface of a truth."""

    def __init__(
        self,
        paths: dict[int, tuple[tuple[float, float, float], tuple[float, float, float]]],
        *,
        visible: float | None = 1.0,
        role: str = "obstacle",
        camera: Pose | None = None,
    ) -> None:
        self.paths, self.visible, self.role, self.camera = paths, visible, role, camera

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        return tuple(
            TrueBody(
                id=number,
                name="robot",
                role=self.role,
                position=np.array(start) + time * np.array(velocity),
                velocity=np.array(velocity, float),
                size=SIZE,
                yaw=float(np.arctan2(velocity[0], velocity[2])),
                visible=self.visible,
                commanded_speed=None,
            )
            for number, (start, velocity) in self.paths.items()
        )

    def camera_pose(self, time: float) -> Pose | None:
        assert np.isfinite(time)
        return self.camera


RIGHT = {1: ((-1.0, 0.0, 3.0), (0.4, 0.0, 0.0))}


def entry(truth: StraightTruth, time: float, body: int = 0, **changes: Any) -> dict[str, Any]:
    """Return a perfect report of one body, with the given changes."""
    b = truth.bodies(time)[body]
    offset = np.array(changes.pop("offset", (0, 0, 0)))
    error = np.array(changes.pop("error", (0, 0, 0)))
    velocity = b.velocity + error
    return {
        "id": 7 + body,
        "state": "confirmed",
        "motion": "moving",
        "position": (b.position + offset).tolist(),
        "velocity": velocity.tolist(),
        "speed": float(np.linalg.norm(velocity)),
        "velocity_cov": (np.eye(3) * 0.01).tolist(),
        "velocity_time": time - DT / 2,
    } | changes


def line(frame: int, obstacles: list[dict[str, Any]], **changes: Any) -> dict[str, Any]:
    return {
        "frame": frame,
        "time": frame * DT,
        "segment": 0,
        "status": "ok",
        "pose": {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]},
        "obstacles": obstacles,
    } | changes


def perfect(truth: StraightTruth, count: int, **changes: Any) -> list[dict[str, Any]]:
    bodies = range(len(truth.paths))
    return [
        line(k, [entry(truth, k * DT, body, **changes) for body in bodies]) for k in range(count)
    ]
