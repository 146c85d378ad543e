"""Pairing of true bodies with observations that were recorded without them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import scipy

from observer.geometry import Pose
from observer.jsonl import line_pose
from observer.recording.payloads import MatchedBody, MatchedTruth
from observer.truth.contract import TrueBody, Truth

# As in the engine's pairing: within this distance of a body's surface (its half length).
_GATE_M = 1.0
_REFUSED = 1e6


def pair_with_truth(lines: Iterable[Mapping[str, Any]], truth: Truth) -> tuple[MatchedTruth, ...]:
    """Return the true bodies in each observation's world, with the tracks nearest to them.

    The two worlds are aligned once per segment, at its first pose.
    """
    worlds: dict[int, Pose] = {}
    found = []
    for line in lines:
        pose, segment, time = line_pose(line), int(line["segment"]), float(line["time"])
        if segment not in worlds and pose is not None:
            true_pose = truth.camera_pose(time)
            if true_pose is not None:
                worlds[segment] = pose @ true_pose.inverse()
            elif segment == 0:
                worlds[segment] = Pose.identity()
        if segment not in worlds:
            continue
        T = worlds[segment]
        bodies = truth.bodies(time)
        tracks = _assigned([b for b in bodies if b.role != "observer"], T, line["obstacles"])
        entries = [_entry(body, T, tracks.get(body.id)) for body in bodies]
        found.append(MatchedTruth(frame=int(line["frame"]), time=time, bodies=entries))
    return tuple(found)


def _assigned(
    bodies: list[TrueBody], T: Pose, obstacles: Iterable[Mapping[str, Any]]
) -> dict[int, int]:
    placed = [entry for entry in obstacles if entry["position"] is not None]
    if not bodies or not placed:
        return {}
    true = T.apply([body.position for body in bodies])
    seen = np.array([entry["position"] for entry in placed])
    distance = np.linalg.norm(true[:, None] - seen[None], axis=2)
    gates = np.array([_GATE_M + float(body.size[0]) / 2 for body in bodies])
    cost = np.where(distance <= gates[:, None], distance, _REFUSED)
    rows, columns = scipy.optimize.linear_sum_assignment(cost)
    return {
        bodies[row].id: int(placed[column]["id"])
        for row, column in zip(rows, columns, strict=True)
        if cost[row, column] < _REFUSED
    }


def _entry(body: TrueBody, T: Pose, track: int | None) -> MatchedBody:
    ahead = T.rotate([np.sin(body.yaw), 0.0, np.cos(body.yaw)])
    return MatchedBody(
        id=body.id,
        name=body.name,
        role=body.role,
        position=T.apply(body.position).tolist(),
        velocity=T.rotate(body.velocity).tolist(),
        speed=body.speed,
        size=body.size.tolist(),
        yaw=float(np.arctan2(ahead[0], ahead[2])),
        visible=body.visible,
        commanded_speed=body.commanded_speed,
        track_id=track,
    )
