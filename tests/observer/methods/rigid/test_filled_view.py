"""People who fill the view: what is left of the background gives the camera's motion."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters
from observer.types import MotionState

from ...conftest import OpenClip

# Two people side by side, who come closer until they hide nearly everything.
SCENE = """
title: Two people fill the view
help: Two people walk side by side up to the observer, which drives towards them.
based_on: _people
duration_s: 6
observer:
  motion:
    kind: course
    legs:
      - {kind: drive, distance_m: 1.2, speed: 0.2}
people:
  - x: 4.8
    y: 0.36
    heading_deg: 180
    motion:
      kind: course
      acceleration: 1.0
      legs:
        - {kind: drive, distance_m: 3.4, speed: 0.8}
  - x: 4.8
    y: -0.36
    heading_deg: 180
    motion:
      kind: course
      acceleration: 1.0
      legs:
        - {kind: drive, distance_m: 3.4, speed: 0.8}
"""
# Frames: the people hide more than half of the view from the first on, and nearly all of it after
# the last.
FILLED, HIDDEN = 60, 72
# Metres, most error of the camera's motion between two frames: people come closer by 0.05.
STEP_M = 0.02


def test_people_who_fill_the_view_are_not_taken_for_the_background(
    tmp_path: Path, clip: OpenClip
) -> None:
    """Most points move like them then, and would seem to stand while the camera rushes on."""
    path = tmp_path / "filled.yaml"
    path.write_text(SCENE)
    here = clip(f"simulated:{path}?seed=3", HIDDEN)
    assert here.truth is not None
    observer = Observer(here.calibration, Parameters())
    seen = [observer.observe(frame) for frame in here.frames]
    for before, now in pairwise(seen[FILLED - 1 :]):
        assert before.T_world_camera is not None
        assert now.T_world_camera is not None
        was, then = (here.truth.camera_pose(o.time) for o in (before, now))
        assert was is not None
        assert then is not None
        step = before.T_world_camera.inverse() @ now.T_world_camera
        error = (was.inverse() @ then).inverse() @ step
        assert np.linalg.norm(error.translation) < STEP_M
        farther = max(now.reported, key=lambda o: float(np.linalg.norm(o.position_camera)))
        assert farther.motion is MotionState.MOVING
        assert farther.speed == pytest.approx(0.69, abs=0.15)
