"""The whole method on rendered stereo with known motion, and what it does when input is bad."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import json
import textwrap
from typing import Any

import cv2
import numpy as np
import pytest

from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.parameters import Parameters, preset
from observer.types import (
    FullTrace,
    Observation,
    Status,
    StereoFrame,
    TrackState,
)

WIDTH, HEIGHT, F, BASELINE = 512, 256, 443.0, 0.12
CALIBRATION = StereoCalibration.rectified(WIDTH, HEIGHT, F, F, 255.5, 127.5, BASELINE)
DT = 1 / 15
WALL_M, BOARD_M = 4.0, 2.0


def _texture(seed: int, size: tuple[int, int], blur: float) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, size).astype(np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), blur), None, 10, 245, cv2.NORM_MINMAX)


_WALL = _texture(1, (900, 1800), 2.0)
_BOARD = _texture(2, (70, 100), 1.5)


def render(camera: tuple[float, float, float], board_x: float | None, eye: float) -> np.ndarray:
    """A wall at 4 m and a board at 2 m, seen by a camera at ``camera`` shifted by ``eye``, m."""
    x, y, z = camera[0] + eye, camera[1], camera[2]
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    # One texture pixel at the wall is one image pixel as seen from the start.
    scale = (WALL_M - z) / WALL_M
    wall = cv2.remap(
        _WALL,
        ((u - 255.5) * scale + x * F / WALL_M + 900).astype(np.float32),
        ((v - 127.5) * scale + y * F / WALL_M + 450).astype(np.float32),
        cv2.INTER_LINEAR,
    )
    if board_x is None:
        return wall
    scale = (BOARD_M - z) / BOARD_M
    board_u = ((u - 255.5) * scale + (x - board_x) * F / BOARD_M + 50).astype(np.float32)
    board_v = ((v - 127.5) * scale + y * F / BOARD_M + 35).astype(np.float32)
    board = cv2.remap(_BOARD, board_u, board_v, cv2.INTER_LINEAR)
    on_board = (board_u >= 0) & (board_u < 99) & (board_v >= 0) & (board_v < 69)
    return np.where(on_board, board, wall)


def frames(count: int, **scene: Any) -> list[StereoFrame]:
    """Rendered frames, see ``_frames``; rendered once for all tests that ask for the same."""
    return list(_frames(count, **scene))


@functools.cache
def _frames(
    count: int,
    *,
    board_speed: float | None = 0.4,
    camera_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    times: tuple[float, ...] | None = None,
    color: bool = False,
    seed: int = 0,
) -> tuple[StereoFrame, ...]:
    rng = np.random.default_rng(seed)
    out = []
    for k, t in enumerate(np.arange(count) * DT if times is None else times):
        camera = tuple(np.array(camera_velocity) * t)
        board = None if board_speed is None else -0.4 + board_speed * t
        images = [
            np.clip(render(camera, board, eye) + rng.normal(0, 2, (HEIGHT, WIDTH)), 0, 255)
            for eye in (0.0, BASELINE)
        ]
        left, right = (image.astype(np.uint8) for image in images)
        if color:
            left, right = (cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in (left, right))
        out.append(StereoFrame(k, float(t), left, right, received=100.0 + t))
    return tuple(out)


def observe_all(observer: Observer, sequence: list[StereoFrame]) -> list[Observation]:
    return [observer.observe(frame) for frame in sequence]


def fixed_clock() -> float:
    return 0.0


@pytest.fixture(scope="module")
def moving() -> list[StereoFrame]:
    """The board crosses to the right at 0.4 m/s, the camera drives sideways at 0.1 m/s."""
    return frames(10, camera_velocity=(0.1, 0.0, 0.0))


@pytest.mark.parametrize("name", ["paper", "default"])
@pytest.mark.parametrize("camera", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.15)])
def test_a_moving_board_is_confirmed_with_its_velocity(name: str, camera) -> None:
    observer = Observer(CALIBRATION, preset(name))
    seen = observe_all(observer, frames(8, camera_velocity=camera))
    assert all(o.status is Status.OK for o in seen[1:])
    for k, observation in enumerate(seen[4:], 4):
        board = [o for o in observation.reported if abs(o.position_camera[2] - 2.0) < 0.3]
        assert len(board) == 1
        (o,) = board
        assert o.state is TrackState.CONFIRMED
        assert o.velocity is not None
        # By the affine model the board, at half the wall's distance, seems to move with the
        # camera's velocity times (2 m / 4 m - 1): its weakness, and part of its stated error.
        assert o.velocity[0] == pytest.approx(0.4 - camera[0] / 2, abs=0.06)
        assert abs(o.velocity[1]) < 0.06
        assert o.velocity_cov is not None
        depth_error = o.velocity[2] + camera[2] / 2
        assert abs(depth_error) < 3 * np.sqrt(o.velocity_cov[2, 2])
        assert o.speed_std is not None
        assert abs(o.speed - 0.4) < 3 * o.speed_std
        centre = -0.4 + 0.4 * k * DT
        assert o.position is not None
        np.testing.assert_allclose(o.position, (centre, 0, BOARD_M), atol=0.12)
        assert o.velocity_time == pytest.approx((k - observer.parameters.frames.interval / 2) * DT)
        u0, v0, u1, v1 = o.box_px
        centre_px = 255.5 + F * o.position_camera[0] / o.position_camera[2]
        assert u0 < centre_px < u1
        assert v0 < 127.5 < v1
        assert "standard deviations" in o.reason
    assert len({o.id for s in seen[4:] for o in s.reported if o.position_camera[2] < 2.3}) == 1


@pytest.mark.parametrize("name", ["paper", "default"])
def test_a_plain_wall_has_no_obstacles_however_the_camera_moves(name: str) -> None:
    sequence = frames(8, board_speed=None, camera_velocity=(0.15, 0.05, 0.2))
    for observation in observe_all(Observer(CALIBRATION, preset(name)), sequence)[1:]:
        assert observation.status is Status.OK
        assert observation.reported == ()
        expected = np.array([0.15, 0.05, 0.2]) * observation.time
        assert observation.T_world_camera is not None
        np.testing.assert_allclose(observation.T_world_camera.translation, expected, atol=0.04)


def test_parallax_is_called_moving_by_the_paper_and_not_by_the_default() -> None:
    """The board stands still; an affine model of the wall cannot know how near it is."""
    sequence = frames(8, board_speed=0.0, camera_velocity=(0.35, 0.0, 0.0))
    paper = observe_all(Observer(CALIBRATION, preset("paper")), sequence)
    default = observe_all(Observer(CALIBRATION, preset("default")), sequence)
    assert paper[-1].reported
    assert not default[-1].reported


@pytest.mark.parametrize("name", ["paper", "default"])
def test_equal_input_gives_equal_results_to_the_last_digit(moving, name: str) -> None:
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


def test_the_first_frame_says_so() -> None:
    (first,) = observe_all(Observer(CALIBRATION), frames(1))
    assert any("first frame" in reason for reason in first.reasons)
    assert first.obstacles == ()
    assert first.segment == 0
    assert first.T_world_camera is not None
    np.testing.assert_array_equal(first.T_world_camera.matrix, np.eye(4))


def test_lines_have_no_nan_and_carry_what_was_observed(moving) -> None:
    observer = Observer(CALIBRATION, preset("default"), parameters_revision=7)
    line = observation_line(observe_all(observer, moving)[-1])
    again = json.loads(json.dumps(line, allow_nan=False))
    assert again["frame"] == 9
    assert again["parameters_revision"] == 7
    assert again["obstacles"][0]["state"] == "confirmed"
    assert set(again["timings_ms"]) >= {"stereo", "ego_motion", "residual_flow", "total"}


def test_the_trace_holds_every_step(moving) -> None:
    trace = FullTrace()
    observer = Observer(CALIBRATION, preset("paper"))
    observe_all(observer, moving[:5])
    observer.observe(moving[5], trace)
    assert set(trace) == {
        "time", "motions", "left", "right", "previous_left", "previous_right", "previous_time",
        "features_px",
        "matches", "ego_motion", "decomposition", "warped_left", "warped_right", "flow_px",
        "flow_observed_px", "flow_residual_px", "dynamic", "disparity", "warped_disparity",
        "points_previous", "points_current", "detections",
    }  # fmt: skip
    for name in trace:
        assert name in (inspect.getmodule(Observer).__doc__ or "") or name.endswith("_right")
    np.testing.assert_array_equal(trace["left"], moving[5].left)
    np.testing.assert_array_equal(trace["previous_left"], moving[4].left)
    assert len(trace["ego_motion"].inliers) == len(trace["matches"])
    assert len(trace["flow_px"]) == len(trace["dynamic"]) == len(trace["flow_residual_px"])
    assert trace["dynamic"].any()
    assert trace["points_previous"].shape == trace["points_current"].shape
    assert set(trace["decomposition"]) == {"translation_px", "rotation_rad", "shear", "scale"}


def test_a_trace_changes_nothing(moving) -> None:
    lines = []
    for trace in (True, False):
        observer = Observer(CALIBRATION, clock=fixed_clock)
        seen = [observer.observe(f, FullTrace()) if trace else observer.observe(f) for f in moving]
        lines.append([observation_line(o, tentative=True) for o in seen])
    assert lines[0] == lines[1]


def test_colour_images_give_the_same_as_grey_ones() -> None:
    grey, color = (
        observe_all(Observer(CALIBRATION, clock=fixed_clock), frames(5, color=c))
        for c in (False, True)
    )
    assert [observation_line(o) for o in grey] == [observation_line(o) for o in color]


def test_the_interval_chooses_the_pair_and_dt_is_measured() -> None:
    parameters = preset("default").changed({"frames.interval": 3})
    observer = Observer(CALIBRATION, parameters)
    sequence = frames(9, board_speed=0.15)
    for frame in sequence[:-1]:
        observer.observe(frame)
    trace = FullTrace()
    seen = observer.observe(sequence[-1], trace)
    np.testing.assert_array_equal(trace["previous_left"], sequence[5].left)
    (board,) = seen.reported
    assert board.speed == pytest.approx(0.15, abs=0.04)
    assert board.velocity_time == pytest.approx(6.5 * DT)


def test_speed_follows_uneven_times_and_dropped_frames() -> None:
    steps = np.array([0.05, 0.09, 0.05, 0.13, 0.06, 0.1, 0.05, 0.08])
    times = (0.0, *np.cumsum(steps).tolist())
    sequence = frames(9, times=times)
    del sequence[6]
    seen = observe_all(Observer(CALIBRATION, preset("default")), sequence)
    for observation in seen[4:]:
        (board,) = observation.reported
        assert board.speed == pytest.approx(0.4, abs=0.07)
    assert any("1 frame missing" in reason for reason in seen[6].reasons)
    assert seen[6].status is Status.OK


def black(frame: StereoFrame) -> StereoFrame:
    dark = np.zeros_like(frame.left)
    return StereoFrame(frame.index, frame.time, dark, dark, frame.received)


def test_a_short_loss_is_bridged_and_the_world_stays() -> None:
    sequence = frames(12, camera_velocity=(0.1, 0.0, 0.0))
    sequence[6], sequence[7] = black(sequence[6]), black(sequence[7])
    seen = observe_all(Observer(CALIBRATION, preset("default")), sequence)
    for lost in seen[6:8]:
        assert lost.status is Status.LOST
        assert "black" in lost.reasons[0]
        assert any("matches" in reason for reason in lost.reasons)
        assert lost.T_world_camera is None
        assert all(o.position is None and o.velocity is None for o in lost.obstacles)
        assert all(o.state is TrackState.COASTING for o in lost.obstacles)
        json.dumps(observation_line(lost), allow_nan=False)
    assert {o.segment for o in seen} == {0}
    assert seen[8].status is Status.OK
    np.testing.assert_allclose(
        seen[11].T_world_camera.translation, (0.1 * 11 * DT, 0, 0), atol=0.02
    )
    assert {o.id for o in seen[5].reported} == {o.id for o in seen[10].reported}


def test_a_long_loss_begins_a_new_segment() -> None:
    sequence = frames(14)
    sequence[4:9] = [black(frame) for frame in sequence[4:9]]
    parameters = preset("default").changed({"ego_motion.recover_frames": 2})
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    assert [o.segment for o in seen[:6]] == [0] * 6
    assert seen[6].segment == 1
    assert any("new segment" in reason for reason in seen[6].reasons)
    assert seen[13].segment >= 2  # black frames cannot begin one that lasts
    assert seen[13].status is Status.OK
    before = {o.id for s in seen[:6] for o in s.obstacles}
    after = {o.id for s in seen[9:] for o in s.obstacles}
    assert before
    assert after
    assert not before & after


def test_a_repeated_frame_is_left_out(moving) -> None:
    plain = Observer(CALIBRATION, clock=fixed_clock)
    stuttering = Observer(CALIBRATION, clock=fixed_clock)
    expected = observe_all(plain, moving[:6])
    seen = []
    for frame in moving[:6]:
        seen.append(stuttering.observe(frame))
        again = stuttering.observe(frame)
        assert again.status is Status.LOST
        assert "as old as the last one" in again.reasons[0]
        assert again.obstacles == ()
    assert [observation_line(o) for o in seen] == [observation_line(o) for o in expected]


def test_time_that_runs_back_begins_a_new_segment(moving) -> None:
    observer = Observer(CALIBRATION, preset("default"))
    observe_all(observer, moving[:6])
    back = observe_all(observer, moving[:5])
    assert back[0].segment == 1
    assert any("time went back" in reason for reason in back[0].reasons)
    assert back[0].obstacles == ()
    assert back[4].reported


def test_a_new_segment_forgets_everything(moving) -> None:
    observer = Observer(CALIBRATION, preset("default"))
    first = observe_all(observer, moving)
    observer.begin_segment()
    second = observe_all(observer, moving)
    assert {o.segment for o in second} == {1}
    assert second[0].obstacles == ()
    ids = [{o.id for s in seen for o in s.obstacles} for seen in (first, second)]
    assert not ids[0] & ids[1]


def test_images_of_another_size_are_refused_with_both_sizes() -> None:
    observer = Observer(CALIBRATION)
    observe_all(observer, frames(2))
    small = np.zeros((128, 256), np.uint8)
    with pytest.raises(CalibrationError, match=r"256x128 pixels.*512x256"):
        observer.observe(StereoFrame(2, 1.0, small, small, 0.0))
    # and it goes on with the right ones
    assert observer.observe(frames(4)[3]).status is Status.OK


def test_new_parameters_act_from_the_next_frame_on(moving) -> None:
    observer = Observer(CALIBRATION, preset("default"))
    observe_all(observer, moving[:6])
    strict = observer.parameters.changed({"flow.residual_threshold_px": 30.0})
    observer.use(strict, 3)
    after = observer.observe(moving[6])
    assert after.parameters_revision == 3
    assert all(o.state is TrackState.COASTING for o in after.obstacles)
    assert observer.parameters is strict


DETECTORS = ["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb"]


@pytest.mark.parametrize(
    ("detector", "method"), list(itertools.product(DETECTORS, ["descriptor", "klt"]))
)
def test_every_detector_and_matching_finds_the_board(detector: str, method: str) -> None:
    parameters = Parameters().changed(
        {"features.detector": detector, "matching.method": method, "tracking.confirm_hits": 1}
    )
    seen = observe_all(Observer(CALIBRATION, parameters), frames(3, board_speed=0.5))
    board = [o for o in seen[-1].reported if abs(o.position_camera[2] - 2.0) < 0.3]
    assert len(board) == 1
    assert board[0].speed == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("model", ["affine", "homography"])
@pytest.mark.parametrize("matcher", ["bm", "sgbm"])
def test_every_model_and_matcher_finds_the_board(model: str, matcher: str) -> None:
    parameters = preset("default").changed(
        {"ego_motion.model": model, "stereo.matcher": matcher, "tracking.confirm_hits": 1}
    )
    sequence = frames(3, board_speed=0.5, camera_velocity=(0.1, 0, 0.1))
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    (board,) = seen[-1].reported
    assert board.speed == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("picture", ["black", "white", "noise"])
def test_bad_pictures_are_answered_with_a_status_and_never_an_error(picture: str) -> None:
    rng = np.random.default_rng(0)
    observer = Observer(CALIBRATION, preset("default"))
    for frame in frames(6):
        if picture == "noise":
            images = rng.integers(0, 256, (2, HEIGHT, WIDTH)).astype(np.uint8)
        else:
            images = [np.full((HEIGHT, WIDTH), 255 * (picture == "white"), np.uint8)] * 2
        bad = StereoFrame(frame.index, frame.time, *images, frame.received)
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


def test_observe_reads_in_under_fifty_lines() -> None:
    source = textwrap.dedent(inspect.getsource(Observer.observe))
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    body = function.body[1:]  # without the docstring
    assert body[-1].end_lineno - body[0].lineno + 1 < 50
