"""The watches fed as in a run: with frames, observations and traces of the simulated lab."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from observer.calibration.ageing.row_refinement import RowRefinement, refine_from_scene
from observer.calibration.ageing.watch import AgeingWatch
from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World
from observer.trace import FullTrace
from observer.types import StereoFrame


def test_run_with_row_drift_warns_and_can_be_refined(clip: Callable[[str, int], Any]) -> None:
    frames = clip("simulated:turning?seed=1", 90).frames
    text = "based_on: turning\nfaults: {miscalibration: {pitch_deg: 0.1, roll_deg: -0.05}}"
    world = World(scenario_from_text(text, "wrong"), 1)
    observer = Observer(world.calibration)
    watch = AgeingWatch(observer.camera)
    for frame in frames:
        trace = FullTrace()
        age = watch.add_frame(frame, observer.observe(frame, trace), trace)
    assert age.rows.warning is not None
    assert "pitch" in age.rows.warning
    assert age.vergence.status in ("consistent", "unobserved")
    assert len(watch.pairs) == 2
    found = refine_from_scene(world.calibration, watch.pairs)
    assert isinstance(found, RowRefinement)
    turn = found.calibration.R @ world.true_calibration.R.T
    pitch, yaw, roll = np.degrees([turn[2, 1], turn[0, 2], turn[1, 0]])
    assert abs(pitch) < 0.012
    assert abs(roll) < 0.02
    assert abs(yaw) < 0.002


def test_vergence_found_from_points_alone_is_refined() -> None:
    """Without wheels, near and far points seen while driving correct the calibration."""
    world = World(load_scenario("static_vergence"), 0)
    source = SimulatedSource(world)
    observer = Observer(source.calibration)
    watch = AgeingWatch(observer.camera)
    for _ in range(50):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        frame = replace(frame, odometry=None)
        trace = FullTrace()
        age = watch.add_frame(frame, observer.observe(frame, trace), trace)
    assert age.exposure_skew is None
    check = age.vergence
    assert check.status == "drifted"
    assert check.vergence_rad is not None
    assert check.std_rad is not None
    assert abs(check.vergence_rad - np.deg2rad(0.078)) < 3 * check.std_rad
    found = refine_from_scene(source.calibration, watch.pairs, check)
    assert isinstance(found, RowRefinement)
    true = world.true_calibration
    turn = found.calibration.R @ true.R.T
    before = source.calibration.R @ true.R.T
    assert abs(np.degrees(before[0, 2])) > 0.07
    assert abs(np.degrees(turn[0, 2])) < np.degrees(3 * check.std_rad)


def test_nothing_is_claimed_without_stereo_matches(clip: Callable[[str, int], Any]) -> None:
    here = clip("simulated:turning?seed=1", 90)
    parameters = Parameters().changed({"ego_motion.model": "affine"})
    observer = Observer(here.calibration, parameters)
    watch = AgeingWatch(observer.camera)
    for frame in here.frames[:9]:
        trace = FullTrace()
        age = watch.add_frame(frame, observer.observe(frame, trace), trace)
    assert age.rows.now_px is None
    assert age.rows.warning is None
    assert age.vergence.status == "unobserved"
    assert "ego_motion.model" in age.vergence.sentence
