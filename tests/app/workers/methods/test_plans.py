"""The scene from above: levelled, to scale, with 95 % ellipses."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from app.contract.robots import GoalNow
from app.workers.methods.plans import Plans
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.mount import CameraMount, level_pose
from observer.recording.payloads import RecordedFrame
from observer.recording.reader import Recording

from ...planted_runs import plant_run


class _Recording:
    """As much of a recording as a plan needs."""

    def __init__(self, mount: CameraMount | None) -> None:
        self.facts = self
        self.segment = 0
        self._mount = mount

    def camera_mount(self) -> CameraMount | None:
        return self._mount


def line(pose: Pose, position: Any, covariance: Any, segment: int = 0) -> ObservationLine:
    obstacle = {
        "id": 4, "state": "confirmed", "motion": "moving", "position": list(position),
        "velocity": [0.5, 0.0, 0.0], "position_cov": covariance,
    }  # fmt: skip
    bare = {
        "frame": 0, "time": 0.0, "segment": segment, "obstacles": [obstacle],
        "pose": {
            "position": pose.translation.tolist(),
            "orientation_wxyz": pose.quaternion_wxyz.tolist(),
        },
    }  # fmt: skip
    return cast(ObservationLine, bare)


def frame(number: int, time: float) -> RecordedFrame:
    return RecordedFrame(index=number, time=time, received=time)


def test_a_tilted_camera_gives_a_level_plan() -> None:
    tilt = math.radians(20)
    plans = Plans(_Recording(CameraMount(1.0, tilt)), None)  # type: ignore[arg-type]
    # 3 m ahead and 1 m to the left on the ground, in axes of a camera that looks down.
    level = np.array([-1.0, 1.0, 3.0])
    down = np.array(
        [[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]]
    )
    plan = plans.of(frame(0, 7.0), line(Pose.identity(), down @ level, None))
    (found,) = plan.obstacles
    assert plan.time == 7.0
    assert found.at == pytest.approx([3.0, 1.0], abs=1e-3)
    # To the right.
    assert found.velocity == pytest.approx([0.0, -0.5], abs=1e-3)
    assert found.ellipse is None
    assert plan.camera == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


_GOAL = GoalNow(
    state="driving",
    sentence="Driving to the goal.",
    place=(2.0, 1.0),
    distance_m=2.2,
    elapsed_s=1.0,
    path=[(0.5, 0.0), (1.0, 0.3)],
    risk_per_metre=0.001,
    planned_risk_per_metre=None,
    waits_for=None,
    meets_s=None,
)


def test_goal_and_path_are_placed_relative_to_the_robot() -> None:
    """The camera is 0.2 m before the axle, looks down and has gone 3 m and turned left by 90°."""
    mount = CameraMount(1.0, math.radians(20), forward_m=0.2)
    T_level_base = Pose.from_rotvec([0.0, 0.0, math.pi / 2], [3.0, 0.5, 0.0])
    T_level_camera = T_level_base @ mount.T_base_camera
    pose = level_pose(mount).inverse() @ T_level_camera
    plans = Plans(_Recording(mount), None)  # type: ignore[arg-type]
    seen = line(pose, [0, 0, 2], None)
    plan = plans.of(frame(0, 0.0), seen, _GOAL)
    assert plan.goal == pytest.approx([2.0, 2.5], abs=2e-3)
    np.testing.assert_allclose(plan.path, [[3.0, 1.0], [2.7, 1.5]], atol=2e-3)
    reached = plans.of(frame(1, 0.1), seen, replace(_GOAL, state="reached"))
    assert (reached.goal, list(reached.path)) == (None, [])
    lost = plans.of(frame(2, 0.2), None, _GOAL)
    assert (lost.goal, list(lost.path)) == (None, [])


def test_an_ellipse_contains_95_per_cent() -> None:
    covariance = np.diag([0.01, 1.0, 0.04])
    plan = Plans(_Recording(None), None).of(  # type: ignore[arg-type]
        frame(0, 0.0), line(Pose.identity(), [0, 0, 2], covariance.tolist())
    )
    along, across, angle = plan.obstacles[0].ellipse or ()
    assert (along, across) == pytest.approx((2.448 * 0.2, 2.448 * 0.1), abs=1e-3)
    assert math.sin(angle) == pytest.approx(0.0, abs=1e-3)
    rng = np.random.default_rng(1)
    samples = rng.multivariate_normal([0, 0], [[0.04, 0], [0, 0.01]], 20_000)
    inside = (samples[:, 0] / along) ** 2 + (samples[:, 1] / across) ** 2 < 1
    assert inside.mean() == pytest.approx(0.95, abs=0.006)


def test_time_continues_after_a_source_restart_and_lost_frames_have_plans(
    tmp_path: Path,
) -> None:
    with Recording(plant_run(tmp_path)) as recording:
        plans = Plans(recording, None)
        lines = list(recording.lines())
        first = plans.of(recording.frames[0], lines[0])
        lost = plans.of(recording.frames[1], None)
        assert (lost.camera, lost.obstacles, lost.truth) == (None, [], [])
        again = RecordedFrame(index=0, time=0.0, received=900.0, begins="observer")
        third = plans.of(again, {**lines[0], "segment": 1})
        assert first.time < lost.time < third.time
        assert third.segment == 1
