"""The whole method on rendered stereo with known motion, and its handling of bad input."""

from __future__ import annotations

import ast
import inspect
import itertools
import json
import re
import textwrap

import cv2
import numpy as np
import pytest

from observer.errors import CalibrationError
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.parameters import Parameters, preset
from observer.trace import FullTrace
from observer.types import Status, StereoFrame, TrackState

from .rendered_board import (
    BOARD_M,
    CALIBRATION,
    DT,
    HEIGHT,
    WIDTH,
    F,
    black,
    frames,
    observe_all,
)

PLANAR = Parameters().changed({"ego_motion.model": "affine"})


def fixed_clock() -> float:
    return 0.0


@pytest.fixture(scope="module")
def moving() -> list[StereoFrame]:
    """The board crosses to the right at 0.4 m/s, the camera drives sideways at 0.1 m/s."""
    return frames(10, camera_velocity=(0.1, 0.0, 0.0))


@pytest.mark.parametrize("camera", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.15)])
def test_a_moving_board_is_confirmed_with_its_velocity(camera: tuple[float, float, float]) -> None:
    seen = observe_all(Observer(CALIBRATION), frames(9, camera_velocity=camera))
    # Until that is certain, it counts as possibly having started to move.
    early = [reason for each in seen[1:5] for reason in each.reasons]
    assert all(reason.startswith("something may have started to move") for reason in early)
    for k, observation in enumerate(seen[5:], 5):
        assert observation.status is Status.OK
        (o,) = observation.reported
        assert o.state is TrackState.CONFIRMED
        assert o.velocity is not None
        np.testing.assert_allclose(o.velocity, (0.4, 0, 0), atol=0.03)
        assert o.velocity_cov is not None
        error = o.velocity - (0.4, 0, 0)
        assert error @ np.linalg.inv(o.velocity_cov) @ error < 3.0**2
        # The velocity is that at the frame's time.
        assert o.velocity_time == pytest.approx(k * DT)
        assert o.position is not None
        # The board's thickness is unknown: its far side is not seen.
        assert abs(o.position[0] - (-0.4 + 0.4 * k * DT)) < 0.06
        assert abs(o.position[1]) < 0.06
        assert -0.05 < o.position[2] - BOARD_M < 0.25
        u0, v0, u1, v1 = o.box_px
        centre_px = 255.5 + F * o.position_camera[0] / o.position_camera[2]
        assert u0 < centre_px < u1
        assert v0 < 127.5 < v1
        assert "σ above zero" in o.reason
    assert len({o.id for s in seen[5:] for o in s.reported}) == 1


@pytest.mark.parametrize("name", ["paper", "default"])
def test_a_static_wall_has_no_obstacles_while_the_camera_moves(name: str) -> None:
    sequence = frames(8, board_speed=None, camera_velocity=(0.15, 0.05, 0.2))
    for observation in observe_all(Observer(CALIBRATION, preset(name)), sequence)[1:]:
        assert observation.status is Status.OK
        assert observation.reported == ()
        expected = np.array([0.15, 0.05, 0.2]) * observation.time
        assert observation.T_world_camera is not None
        np.testing.assert_allclose(observation.T_world_camera.translation, expected, atol=0.04)


def test_parallax_is_reported_as_motion_only_by_the_paper_preset() -> None:
    """The board stands still; an affine model of the wall cannot account for its nearness."""
    sequence = frames(8, board_speed=0.0, camera_velocity=(0.35, 0.0, 0.0))
    paper = observe_all(Observer(CALIBRATION, preset("paper")), sequence)
    default = observe_all(Observer(CALIBRATION, preset("default")), sequence)
    assert paper[-1].reported
    assert not default[-1].reported


@pytest.mark.parametrize("name", ["paper", "default"])
def test_equal_input_gives_identical_results_for_any_thread_count(
    moving: list[StereoFrame], name: str
) -> None:
    before = cv2.getNumThreads()
    lines = []
    try:
        for threads in (1, 2, 4):
            cv2.setNumThreads(threads)
            observer = Observer(CALIBRATION, preset(name), clock=fixed_clock)
            seen = observe_all(observer, moving)
            lines.append([json.dumps(observation_line(o, tentative=True)) for o in seen])
    finally:
        cv2.setNumThreads(before)
    assert lines[0] == lines[1] == lines[2]
    assert '"confirmed"' in lines[0][-1]


def test_the_first_frame_is_reported_as_such() -> None:
    (first,) = observe_all(Observer(CALIBRATION), frames(1))
    assert any("first frame" in reason for reason in first.reasons)
    assert first.obstacles == ()
    assert first.segment == 0
    assert first.T_world_camera is not None
    np.testing.assert_array_equal(first.T_world_camera.matrix, np.eye(4))


def test_lines_contain_the_observation_and_no_nan(moving: list[StereoFrame]) -> None:
    observer = Observer(CALIBRATION, preset("default"), parameters_revision=7)
    line = observation_line(observe_all(observer, moving)[-1])
    again = json.loads(json.dumps(line, allow_nan=False))
    assert again["frame"] == 9
    assert again["parameters_revision"] == 7
    assert again["obstacles"][0]["state"] == "confirmed"
    assert set(again["timings_ms"]) >= {"klt_tracking", "ego_motion", "motion", "tracking", "total"}


# What the trace receives with either method, as in the module's table.
BOTH = {
    "time", "left", "right", "previous_left", "previous_right", "previous_time", "features_px",
    "matches", "ego_motion", "flow_px", "flow_observed_px", "flow_residual_px", "dynamic",
}  # fmt: skip
PLANAR_ONLY = {
    "decomposition", "disparity", "warped_left", "warped_right", "warped_disparity", "motions",
    "points_previous", "points_current", "detections",
}  # fmt: skip

RIGID_ONLY = {"evidence", "rows", "disparity_bias", "exposure_skew", "unseen"}
# The trace of the one-camera method is tested with that method.
ONE_CAMERA_ONLY = {"rays", "ray_evidence"}


@pytest.mark.parametrize(
    ("parameters", "own"),
    [(PLANAR, PLANAR_ONLY), (preset("paper"), PLANAR_ONLY), (Parameters(), RIGID_ONLY)],
)
def test_the_trace_contains_every_documented_step(
    moving: list[StereoFrame], parameters: Parameters, own: set[str]
) -> None:
    trace = FullTrace()
    observer = Observer(CALIBRATION, parameters)
    observe_all(observer, moving[:5])
    observer.observe(moving[5], trace)
    assert set(trace) == BOTH | own
    np.testing.assert_array_equal(trace["left"], moving[5].left)
    assert len(trace["ego_motion"].inliers) == len(trace["matches"])
    assert len(trace["flow_px"]) == len(trace["dynamic"]) == len(trace["flow_residual_px"])
    assert trace["dynamic"].any()
    residual = trace["flow_observed_px"] - trace["flow_px"]
    np.testing.assert_allclose(residual, trace["flow_residual_px"], atol=1e-4)
    table = (inspect.getmodule(Observer).__doc__ or "").split("====\n")[1]
    named = set()
    for first, second in re.findall(r"^(\w+)(?:, (_?right))? ", table, re.MULTILINE):
        named |= {first} | ({re.sub("_?left", second, first)} if second else set())
    assert named == BOTH | PLANAR_ONLY | RIGID_ONLY | ONE_CAMERA_ONLY


@pytest.mark.parametrize("parameters", [PLANAR, Parameters()])
def test_a_trace_changes_nothing(moving: list[StereoFrame], parameters: Parameters) -> None:
    lines = []
    for trace in (True, False):
        observer = Observer(CALIBRATION, parameters, clock=fixed_clock)
        seen = [observer.observe(f, FullTrace()) if trace else observer.observe(f) for f in moving]
        lines.append([observation_line(o, tentative=True) for o in seen])
    assert lines[0] == lines[1]


@pytest.mark.parametrize("parameters", [PLANAR, Parameters()])
def test_colour_images_give_the_same_result_as_grey_ones(parameters: Parameters) -> None:
    grey, color = (
        observe_all(Observer(CALIBRATION, parameters, clock=fixed_clock), frames(5, color=c))
        for c in (False, True)
    )
    assert [observation_line(o) for o in grey] == [observation_line(o) for o in color]


@pytest.mark.parametrize("parameters", [PLANAR, Parameters()])
def test_speed_is_right_with_uneven_times_and_dropped_frames(parameters: Parameters) -> None:
    steps = np.array([0.05, 0.09, 0.05, 0.13, 0.06, 0.1, 0.05, 0.08])
    times = (0.0, *np.cumsum(steps).tolist())
    sequence = frames(9, times=times)
    del sequence[6]
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    for observation in seen[4:]:
        (board,) = observation.reported
        assert board.speed == pytest.approx(0.4, abs=0.07)
    assert any("1 frame missing" in reason for reason in seen[6].reasons)
    assert seen[6].status is Status.OK


@pytest.mark.parametrize("parameters", [PLANAR, Parameters()])
def test_a_short_loss_is_bridged_within_the_same_segment(parameters: Parameters) -> None:
    sequence = frames(12, camera_velocity=(0.1, 0.0, 0.0))
    sequence[6], sequence[7] = black(sequence[6]), black(sequence[7])
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    for lost in seen[6:8]:
        assert lost.status is Status.LOST
        assert "black" in lost.reasons[0]
        assert any("too few features" in reason for reason in lost.reasons)
        assert lost.T_world_camera is None
        assert all(o.position is None and o.velocity is None for o in lost.obstacles)
        assert all(o.state is TrackState.COASTING for o in lost.obstacles)
        json.dumps(observation_line(lost), allow_nan=False)
    assert {o.segment for o in seen} == {0}
    assert seen[8].status is Status.OK
    np.testing.assert_allclose(
        seen[11].T_world_camera.translation, (0.1 * 11 * DT, 0, 0), atol=0.02
    )
    assert len(seen[5].reported) == 1
    assert {o.id for o in seen[5].reported} == {o.id for o in seen[10].reported}


def test_a_long_loss_starts_a_new_segment() -> None:
    sequence = frames(26)
    sequence[10:15] = [black(frame) for frame in sequence[10:15]]
    parameters = preset("default").changed({"ego_motion.recover_frames": 2})
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    assert [o.segment for o in seen[:12]] == [0] * 12
    assert seen[12].segment == 1
    assert any("new segment" in reason for reason in seen[12].reasons)
    assert seen[25].segment >= 2  # black frames cannot start a segment that lasts
    assert seen[25].status is Status.OK
    before = {o.id for s in seen[:12] for o in s.reported}
    after = {o.id for s in seen[15:] for o in s.reported}
    assert before
    assert after
    assert not before & after


def test_a_repeated_frame_is_ignored(moving: list[StereoFrame]) -> None:
    plain = Observer(CALIBRATION, clock=fixed_clock)
    stuttering = Observer(CALIBRATION, clock=fixed_clock)
    expected = observe_all(plain, moving[:6])
    seen = []
    for frame in moving[:6]:
        seen.append(stuttering.observe(frame))
        again = stuttering.observe(frame)
        assert again.status is Status.LOST
        assert "has the same time as the last one" in again.reasons[0]
        assert again.obstacles == ()
    assert [observation_line(o) for o in seen] == [observation_line(o) for o in expected]


def test_time_running_backwards_starts_a_new_segment(moving: list[StereoFrame]) -> None:
    observer = Observer(CALIBRATION, preset("default"))
    observe_all(observer, moving[:6])
    back = observe_all(observer, moving[:6])
    assert back[0].segment == 1
    assert any("time jumped back" in reason for reason in back[0].reasons)
    assert back[0].obstacles == ()
    assert back[5].reported


def test_a_new_segment_forgets_everything(moving: list[StereoFrame]) -> None:
    observer = Observer(CALIBRATION, preset("default"))
    first = observe_all(observer, moving)
    observer.begin_segment()
    second = observe_all(observer, moving)
    assert {o.segment for o in second} == {1}
    assert second[0].obstacles == ()
    # Nor is a provisional id used again: who plans by them may still remember the first one.
    ids = [{o.id for s in seen for o in s.obstacles} for seen in (first, second)]
    assert all(min(each) < 0 < max(each) for each in ids)
    assert not ids[0] & ids[1]


def test_images_of_a_wrong_size_are_refused_with_both_sizes() -> None:
    observer = Observer(CALIBRATION)
    observe_all(observer, frames(2))
    small = np.zeros((128, 256), np.uint8)
    with pytest.raises(CalibrationError, match=r"256x128 pixels.*512x256"):
        observer.observe(StereoFrame(2, 1.0, small, small, 0.0))
    # and it continues with frames of the right size
    assert observer.observe(frames(4)[3]).status is Status.OK


@pytest.mark.parametrize("parameters", [PLANAR, Parameters()])
def test_new_parameters_apply_from_the_next_frame(
    moving: list[StereoFrame], parameters: Parameters
) -> None:
    observer = Observer(CALIBRATION, parameters)
    observe_all(observer, moving[:6])
    strict = observer.parameters.changed({"ego_motion.min_inliers": 500, "features.max_count": 50})
    observer.use(strict, 3)
    after = observer.observe(moving[6])
    assert after.parameters_revision == 3
    assert after.status is Status.LOST
    assert after.segment == 0
    assert observer.parameters is strict


def test_changing_the_model_kind_starts_a_new_segment_and_numbers_continue(
    moving: list[StereoFrame],
) -> None:
    observer = Observer(CALIBRATION)
    homography = PLANAR.changed({"ego_motion.model": "homography"})
    numbers: list[set[int]] = []
    segments: list[set[int]] = []
    for parameters in (Parameters(), PLANAR, homography, Parameters()):
        observer.use(parameters, len(segments))
        seen = observe_all(observer, moving)
        segments.append({o.segment for o in seen[:1]} | {o.segment for o in seen})
        numbers.append({o.id for observation in seen for o in observation.reported})
        # Time jumps back at the start of each pass over the clip.
        observer.begin_segment()
    assert [sorted(s) for s in segments] == [[0], [1], [2], [3]]
    assert all(numbers)
    assert all(not a & b for a, b in itertools.combinations(numbers, 2))


def test_only_a_model_of_another_kind_starts_a_new_segment(
    moving: list[StereoFrame],
) -> None:
    homography = PLANAR.changed({"ego_motion.model": "homography"})
    for before, after, segment in (
        (PLANAR, homography, 0),
        (PLANAR, Parameters(), 1),
        (Parameters(), PLANAR, 1),
        (Parameters(), Parameters().changed({"evidence.memory_s": 1.0}), 0),
    ):
        observer = Observer(CALIBRATION, before)
        observe_all(observer, moving[:6])
        observer.use(after, 1)
        observation = observer.observe(moving[6])
        assert observation.segment == segment
        # A new segment starts without the earlier tracks.
        assert bool(observation.reported) == (segment == 0)


@pytest.mark.parametrize("picture", ["black", "white", "noise"])
def test_bad_images_give_a_status_and_never_an_error(picture: str) -> None:
    rng = np.random.default_rng(0)
    observer = Observer(CALIBRATION, preset("default"))
    for frame in frames(6):
        if picture == "noise":
            left, right = rng.integers(0, 256, (2, HEIGHT, WIDTH)).astype(np.uint8)
        else:
            left = right = np.full((HEIGHT, WIDTH), 255 * (picture == "white"), np.uint8)
        bad = StereoFrame(frame.index, frame.time, left, right, frame.received)
        observation = observer.observe(bad)
        assert observation.status is not Status.OK
        assert observation.reasons
        assert observation.reported == ()
        json.dumps(observation_line(observation), allow_nan=False)


def test_timings_come_from_the_injected_clock() -> None:
    ticks = itertools.count()
    observer = Observer(CALIBRATION, clock=lambda: float(next(ticks)))
    seen = observe_all(observer, frames(2))
    assert seen[1].timings_ms["features"] == 1000.0
    assert seen[1].timings_ms["total"] > sum(
        ms for stage, ms in seen[1].timings_ms.items() if stage != "total"
    )


def test_observe_is_shorter_than_fifty_lines() -> None:
    source = textwrap.dedent(inspect.getsource(Observer.observe))
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    body = function.body[1:]  # without the docstring
    assert body[-1].end_lineno - body[0].lineno + 1 < 50
