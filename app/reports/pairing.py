"""Pairing of true bodies with observations that were recorded without them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from observer.geometry import Pose
from observer.jsonl import line_pose
from observer.recording.payloads import MatchedBody, MatchedTruth
from observer.truth.contract import Truth
from observer.truth.matching import assign, entry


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
        positions = {int(each["id"]): each["position"] for each in line["obstacles"]}
        tracks = assign([b for b in bodies if b.role != "observer"], T, positions)
        matched = [MatchedBody.of(entry(body, T, tracks.get(body.id))) for body in bodies]
        found.append(MatchedTruth(frame=int(line["frame"]), time=time, bodies=matched))
    return tuple(found)
