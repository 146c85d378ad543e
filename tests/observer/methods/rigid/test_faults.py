"""Motion in space on bad input: results stay finite, faults are reported, and it recovers."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.jsonl import observation_line
from observer.observer import Observer
from observer.parameters import Parameters
from observer.parameters.reductions import REDUCTIONS, reduced
from observer.types import Observation, Status, StereoFrame, TrackState

from ...conftest import Clip, OpenClip

SPEC = "simulated:lateral?seed=11"
# After changing how bad frames are handled, try more: RIGID_FAULT_EXAMPLES=100.
EXAMPLES = int(os.environ.get("RIGID_FAULT_EXAMPLES", "7"))
RIGID = Parameters().changed({"ego_motion.model": "rigid"})
PLANAR = Parameters().changed({"ego_motion.model": "affine"})


@pytest.fixture(scope="module")
def lateral(clip: OpenClip) -> Clip:
    return clip(SPEC, 45)


def observer_of(clip: Clip, parameters: Parameters = RIGID) -> Observer:
    return Observer(clip.calibration, parameters, clock=lambda: 0.0)


def pair(frame: StereoFrame, change: Callable[[np.ndarray], np.ndarray]) -> StereoFrame:
    return replace(frame, left=change(frame.left), right=change(frame.right))


def black(frame: StereoFrame) -> StereoFrame:
    return pair(frame, np.zeros_like)


def numbers_of(value: Any) -> list[float]:
    """Every number in nested dataclasses, arrays and sequences."""
    if isinstance(value, np.ndarray):
        return value.astype(float).ravel().tolist()
    if isinstance(value, float | int | np.number):
        return [float(value)]
    if is_dataclass(value):
        return [x for f in fields(value) for x in numbers_of(getattr(value, f.name))]
    if isinstance(value, tuple | list):
        return [x for each in value for x in numbers_of(each)]
    if isinstance(value, dict):
        return [x for each in value.values() for x in numbers_of(each)]
    return []


def check_sane(observation: Observation) -> None:
    """Check what holds for every observation, whatever the input."""
    assert all(map(math.isfinite, numbers_of(observation)))
    json.dumps(observation_line(observation, tentative=True), allow_nan=False)
    assert observation.reasons or observation.status is Status.OK
    assert (observation.T_world_camera is None) == (observation.status is Status.LOST)
    for o in observation.obstacles:
        for cov in (o.position_cov, o.velocity_cov):
            if cov is not None:
                assert (np.diag(cov) > 0).all()
                scale = np.sqrt(np.diag(cov))
                assert np.linalg.eigvalsh(cov / np.outer(scale, scale))[0] > -1e-6
        assert (o.size >= 0).all()
        assert o.speed >= 0
        assert o.reason


def test_numbers_of_finds_every_number_of_an_observation(lateral: Clip) -> None:
    observer = observer_of(lateral)
    for frame in lateral.frames[:10]:
        observation = observer.observe(frame)
    found = numbers_of(observation)
    (robot,) = observation.reported
    assert robot.speed in found
    assert robot.velocity_cov[2, 2] in found
    broken = replace(robot, position=np.array([0.0, np.nan, 0.0]))
    with pytest.raises(AssertionError):
        check_sane(replace(observation, obstacles=(broken,)))


@pytest.mark.parametrize("count", [1, 3])
def test_black_frames_are_reported_as_lost_and_recovered_from(lateral: Clip, count: int) -> None:
    observer = observer_of(lateral)
    seen = []
    for k, frame in enumerate(lateral.frames[:40]):
        seen.append(observer.observe(black(frame) if 20 <= k < 20 + count else frame))
        check_sane(seen[-1])
    for lost in seen[20 : 20 + count]:
        assert lost.status is Status.LOST
        assert any("black" in reason for reason in lost.reasons)
        assert lost.T_world_camera is None
        # Known obstacles are still reported, but without a world position.
        (robot,), (known,) = lost.reported, seen[19].reported
        assert robot.id == known.id
        assert robot.state is TrackState.COASTING
        assert robot.position is None
        assert robot.velocity is None
        assert robot.closing_speed is None
        assert robot.points == 0
        assert robot.velocity_time == seen[19].time
        moved = robot.position_camera - known.position_camera
        expected = (lost.time - seen[19].time) * known.velocity_camera
        np.testing.assert_allclose(moved, expected, atol=1e-12)
        assert robot.reason.startswith("not seen for")
    assert {o.segment for o in seen} == {0}
    for after in seen[22 + count :]:
        assert after.status is Status.OK
        assert after.T_world_camera is not None
    # The world frame and the obstacles in it are the same as before.
    truth = lateral.truth.camera_pose(seen[-1].time)
    gap = seen[-1].T_world_camera.translation - truth.translation
    assert np.linalg.norm(gap) < 0.02
    (before,), (now,) = seen[19].reported, seen[-1].reported
    assert before.id == now.id
    assert now.state is TrackState.CONFIRMED
    robots = [b for b in lateral.truth.bodies(seen[-1].time) if b.role != "observer"]
    assert min(abs(now.speed - b.speed) for b in robots) < 0.04


def test_long_darkness_starts_a_new_segment(lateral: Clip) -> None:
    observer = observer_of(lateral)
    dark = range(12, 12 + RIGID.ego_motion.recover_frames + 3)
    seen = [observer.observe(black(f) if k in dark else f) for k, f in enumerate(lateral.frames)]
    for each in seen:
        check_sane(each)
    assert seen[11].segment == 0
    assert any("new segment" in r for each in seen for r in each.reasons)
    assert seen[-1].segment > 0
    assert seen[-1].status is Status.OK
    before = {o.id for each in seen[:12] for o in each.reported}
    after = {o.id for each in seen[-5:] for o in each.reported}
    assert before
    assert after
    assert min(after) > max(before)


def test_swapped_cameras_are_reported_and_nothing_is_invented(lateral: Clip) -> None:
    observer = observer_of(lateral)
    seen = []
    for frame in lateral.frames[:25]:
        seen.append(observer.observe(replace(frame, left=frame.right, right=frame.left)))
        check_sane(seen[-1])
    assert any("swapped" in reason for each in seen for reason in each.reasons)
    assert not any(each.status is Status.OK for each in seen)
    assert not any(each.reported for each in seen)


def test_mismatched_rows_are_reported(lateral: Clip) -> None:
    def lowered(image: np.ndarray, rows: int) -> np.ndarray:
        moved = np.array([[1, 0, 0], [0, 1, rows]], np.float32)
        size = image.shape[1], image.shape[0]
        return cv2.warpAffine(image, moved, size, borderMode=cv2.BORDER_REFLECT)

    for rows, expected in ((2, True), (0, False)):
        observer = observer_of(lateral)
        seen = [
            observer.observe(replace(f, right=lowered(f.right, rows))) for f in lateral.frames[:20]
        ]
        found = [r for each in seen for r in each.reasons if "recalibrate" in r]
        assert bool(found) == expected
        if expected:
            assert "epipolar error is 2.0 px" in found[0]
            assert seen[-1].status is not Status.OK


def test_the_result_does_not_depend_on_the_number_of_threads(lateral: Clip) -> None:
    before, lines = cv2.getNumThreads(), []
    try:
        for threads in (1, 2, 4, 1):
            cv2.setNumThreads(threads)
            observer = observer_of(lateral)
            lines.append(
                [
                    json.dumps(observation_line(observer.observe(f), tentative=True))
                    for f in lateral.frames[:20]
                ]
            )
    finally:
        cv2.setNumThreads(before)
    assert lines[0] == lines[1] == lines[2] == lines[3]
    assert '"confirmed"' in lines[0][-1]


def test_changing_the_model_kind_starts_a_new_segment_and_numbers_continue(lateral: Clip) -> None:
    observer, seen = observer_of(lateral), []
    for k, frame in enumerate(lateral.frames):
        if k == 15:
            observer.use(PLANAR, 1)
        if k == 25:
            observer.use(RIGID, 2)
        seen.append(observer.observe(frame))
    assert [o.segment for o in seen] == [0] * 15 + [1] * 10 + [2] * 20
    assert [o.parameters_revision for o in seen] == [0] * 15 + [1] * 10 + [2] * 20
    for k in (15, 25):
        assert any("first frame" in reason for reason in seen[k].reasons)
        assert seen[k].obstacles == ()
        np.testing.assert_array_equal(seen[k].T_world_camera.matrix, np.eye(4))
    numbers = [
        {o.id for each in part for o in each.reported}
        for part in (seen[:15], seen[15:25], seen[25:])
    ]
    assert numbers[0]
    assert numbers[2]
    assert min(numbers[2]) > max(numbers[0] | numbers[1])
    assert seen[14].reported
    assert seen[-1].reported


def test_new_values_of_the_same_model_keep_the_segment_and_obstacles(lateral: Clip) -> None:
    observer = observer_of(lateral)
    for frame in lateral.frames[:15]:
        before = observer.observe(frame)
    observer.use(RIGID.changed({"obstacles.coast_s": 0.5, "klt_tracking.window_px": 15}), 1)
    after = observer.observe(lateral.frames[15])
    assert after.segment == 0
    assert {o.id for o in after.reported} == {o.id for o in before.reported} != set()


def test_reduced_processing_keeps_the_segment_and_obstacles(lateral: Clip) -> None:
    observer = observer_of(lateral)
    seen = []
    for k, frame in enumerate(lateral.frames):
        if k >= 15 and k % 5 == 0:
            step = REDUCTIONS[(k // 5 - 3) % len(REDUCTIONS)]
            observer.use(reduced(RIGID, step), 0)
        seen.append(observer.observe(frame))
    assert {o.segment for o in seen} == {0}
    before = {o.id for o in seen[14].reported}
    assert before
    assert {o.id for later in seen[15:] for o in later.reported} == before
    assert all(o.reported for o in seen[15:])


# --- arbitrary faults ----------------------------------------------------------------------

KINDS = (
    "black", "white", "noise", "dark", "bright", "swapped", "frozen", "shifted", "one black",
    "upside down", "right from before", "blocks",
)  # fmt: skip


def corrupted(kind: str, frame: StereoFrame, before: StereoFrame, seed: int) -> StereoFrame:
    rng = np.random.default_rng(seed)
    if kind == "black":
        return black(frame)
    if kind == "white":
        return pair(frame, lambda image: np.full_like(image, 255))
    if kind == "noise":
        return pair(frame, lambda image: rng.integers(0, 256, image.shape).astype(np.uint8))
    if kind == "dark":
        # By a different factor in each camera.
        return pair(frame, lambda image: (image * rng.uniform(0.02, 0.6)).astype(np.uint8))
    if kind == "bright":
        gain = rng.uniform(1.3, 4)
        return pair(frame, lambda image: np.clip(image * gain, 0, 255).astype(np.uint8))
    if kind == "swapped":
        return replace(frame, left=frame.right, right=frame.left)
    if kind == "frozen":
        return replace(frame, left=before.left, right=before.right)
    if kind == "shifted":
        by = tuple(rng.integers(-40, 41, 2).tolist())
        return pair(frame, lambda image: np.roll(image, by, axis=(0, 1)))
    if kind == "one black":
        return replace(frame, right=np.zeros_like(frame.right))
    if kind == "upside down":
        return pair(frame, lambda image: np.ascontiguousarray(image[::-1, ::-1]))
    if kind == "right from before":
        return replace(frame, right=before.right)
    damaged = pair(frame, np.copy)
    for image in (damaged.left, damaged.right):
        for _ in range(6):
            v, u = rng.integers(0, image.shape[0] - 48), rng.integers(0, image.shape[1] - 64)
            image[v : v + 48, u : u + 64] = rng.integers(0, 256)
    return damaged


FAULTS = st.dictionaries(
    st.integers(0, 13), st.tuples(st.sampled_from(KINDS), st.integers(0, 99)), min_size=1
)


@given(faults=FAULTS, recover=st.integers(0, 5))
@settings(max_examples=EXAMPLES, derandomize=True)
def test_reported_values_are_finite_for_any_frame_faults(
    lateral: Clip, faults: dict[int, tuple[str, int]], recover: int
) -> None:
    observer = observer_of(lateral, RIGID.changed({"ego_motion.recover_frames": recover}))
    frames = lateral.frames
    for k in range(14):
        frame = frames[k]
        if k in faults:
            kind, seed = faults[k]
            frame = corrupted(kind, frame, frames[max(k - 1, 0)], seed)
        check_sane(observer.observe(frame))
    # It recovers on its own.
    for frame in frames[14 : 14 + recover + 3]:
        last = observer.observe(frame)
        check_sane(last)
    assert last.T_world_camera is not None
    assert last.status is not Status.LOST


@pytest.mark.parametrize("kind", KINDS)
def test_the_robot_is_found_again_after_any_fault(lateral: Clip, kind: str) -> None:
    observer, frames = observer_of(lateral), lateral.frames
    for k, frame in enumerate(frames[:32]):
        if 12 <= k < 15:
            frame = corrupted(kind, frame, frames[k - 1], k)
        observation = observer.observe(frame)
        check_sane(observation)
    # One or two points misled by the fault may still seem to move.
    assert all(reason.startswith("something may have started") for reason in observation.reasons)
    robots = [
        b for b in lateral.truth.bodies(observation.time) if b.role != "observer" and b.speed > 0.05
    ]
    (robot,) = observation.reported
    assert abs(robot.speed - robots[0].speed) < 0.05
