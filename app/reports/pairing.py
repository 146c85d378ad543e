"""Pairing of true bodies with observations that were recorded without them."""

from __future__ import annotations

from collections.abc import Iterable

from observer.jsonl import ObservationLine, line_pose
from observer.recording.payloads import MatchedBody, MatchedTruth
from observer.truth.contract import Truth
from observer.truth.matching import SegmentWorlds, assign, entry


def pair_with_truth(lines: Iterable[ObservationLine], truth: Truth) -> tuple[MatchedTruth, ...]:
    """Return the true bodies in each observation's world, with the tracks nearest to them.

    The two worlds are aligned as by ``SegmentWorlds``.
    """
    worlds = SegmentWorlds(truth)
    found = []
    for line in lines:
        frame, time = line["frame"], line["time"]
        T = worlds.at(line["segment"], frame, time, line_pose(line))
        if T is None:
            continue
        bodies = truth.bodies(time)
        positions = {each["id"]: each["position"] for each in line["obstacles"]}
        tracks = assign([b for b in bodies if b.role != "observer"], T, positions)
        matched = [MatchedBody.of(entry(body, T, tracks.get(body.id))) for body in bodies]
        found.append(MatchedTruth(frame=frame, time=time, bodies=matched))
    return tuple(found)
