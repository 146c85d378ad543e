"""Every detector with every matching method and every ego-motion model, on rendered frames."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from observer.camera import StereoCalibration
from observer.geometry import Pose
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.types import Status, StereoFrame

CHOICES = {e["name"]: e["choices"] for e in Parameters.declared() if e["type"] == "choice"}
COMBINATIONS = list(
    itertools.product(
        CHOICES["features.detector"],
        CHOICES["matching.method"],
        # From frames alone, one camera cannot know the scale; see methods/monocular/test_method.py.
        [model for model in CHOICES["ego_motion.model"] if model != "monocular"],
    )
)
FRAMES = 3


@pytest.fixture(scope="module")
def drive() -> tuple[StereoCalibration, list[StereoFrame], Pose]:
    """The first frames of a slow drive past a moving robot, and the true final pose."""
    opened = open_source("simulated:lateral")
    read = [opened.source.read() for _ in range(FRAMES)]
    frames = [frame for frame in read if isinstance(frame, StereoFrame)]
    assert opened.truth is not None
    assert opened.source.calibration is not None
    pose = opened.truth.camera_pose(frames[-1].time)
    assert pose is not None
    return opened.source.calibration, frames, pose


@pytest.mark.parametrize(("detector", "method", "model"), COMBINATIONS)
def test_the_camera_pose_is_found_with_every_choice(
    drive: tuple[StereoCalibration, list[StereoFrame], Pose], detector: str, method: str, model: str
) -> None:
    calibration, frames, true_pose = drive
    parameters = Parameters().changed(
        {"features.detector": detector, "matching.method": method, "ego_motion.model": model}
    )
    observer = Observer(calibration, parameters)
    newest = [observer.observe(frame) for frame in frames][-1]
    assert newest.status is not Status.LOST, newest.reasons
    assert newest.T_world_camera is not None, newest.reasons
    gap = true_pose.inverse() @ newest.T_world_camera
    # Few corners, close together: depth noise at 5 m then allows some cm and tenths of a degree.
    assert np.linalg.norm(gap.translation) < 0.08
    assert np.degrees(np.linalg.norm(gap.rotvec)) < 0.6
