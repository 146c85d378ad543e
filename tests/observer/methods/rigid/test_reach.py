"""The distance at which moving obstacles are reported, on simulated scenes with ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters
from observer.types import TrackState

from ...conftest import Clip, OpenClip

# Metres and seconds.
SAME_M = 0.8
ALLOWED_S = 0.8

FAR = """
based_on: lateral
title: Far away
help: A robot and a person cross at 9 m.
room: {x: [-1.8, 14.0], y: [-5, 5]}
objects: []
robots:
  - x: 9.0
    y: 1.1
    heading_deg: -90
    motion: {kind: course, legs: [{kind: drive, distance_m: 2.2, speed: 0.6}]}
people:
  - x: 9.5
    y: -3.0
    heading_deg: 90
    motion: {kind: course, legs: [{kind: drive, distance_m: 4.0, speed: 1.0}]}
"""


def reported(clip: Clip, parameters: Parameters) -> tuple[list[float], list[float]]:
    """Distances ahead, metres, of moving bodies: those reported, and those not reported."""
    assert clip.truth is not None
    observer = Observer(clip.calibration, parameters)
    found: list[float] = []
    missed: list[float] = []
    for frame in clip.frames:
        obstacles = observer.observe(frame).obstacles or ()
        places = [o.position for o in obstacles if o.state is TrackState.CONFIRMED]
        for body in clip.truth.bodies(frame.time):
            if body.role == "observer" or frame.time < ALLOWED_S:
                continue
            near = any(np.linalg.norm(place - body.position) < SAME_M for place in places)
            (found if near else missed).append(float(body.position[2]))
    return found, missed


@pytest.mark.parametrize("seed", [1, 4])
def test_a_short_baseline_detects_an_approaching_person_from_far_away(
    seed: int, clip: OpenClip, rigid: Parameters
) -> None:
    """Four cells of disparity, needed for precise depth, reach only 3.4 m there."""
    found, _ = reported(clip(f"simulated:people_short_baseline?seed={seed}", 45), rigid)
    assert len(found) > 15
    assert max(found) > 4.5


@pytest.mark.parametrize("seed", [1, 2])
def test_a_body_crossing_beyond_segment_range_is_reported_by_its_points(
    seed: int, clip: OpenClip, rigid: Parameters, tmp_path: Path
) -> None:
    """Four cells of disparity reach 6.6 m there."""
    scenario = tmp_path / "far.yaml"
    scenario.write_text(FAR)
    found, missed = reported(clip(f"simulated:{scenario}?seed={seed}", 45), rigid)
    assert min(found) > 8
    assert len(found) > 0.8 * (len(found) + len(missed))
