"""The whole published method on rendered stereo with known motion."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters, preset
from observer.trace import FullTrace
from observer.types import Status, TrackState

from ...rendered_board import BOARD_M, CALIBRATION, DT, F, black, frames, observe_all

PLANAR = Parameters().changed({"ego_motion.model": "affine"})


@pytest.mark.parametrize("parameters", [preset("paper"), PLANAR], ids=["paper", "affine"])
@pytest.mark.parametrize("camera", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.15)])
def test_a_moving_board_is_confirmed_as_the_model_sees_it(
    parameters: Parameters, camera: tuple[float, float, float]
) -> None:
    observer = Observer(CALIBRATION, parameters)
    seen = observe_all(observer, frames(8, camera_velocity=camera))
    assert all(o.status is Status.OK for o in seen[1:])
    for k, observation in enumerate(seen[4:], 4):
        board = [o for o in observation.reported if abs(o.position_camera[2] - 2.0) < 0.3]
        assert len(board) == 1
        (o,) = board
        assert o.state is TrackState.CONFIRMED
        assert o.velocity is not None
        # With the affine model the board, at half the wall's distance, appears to move with the
        # camera's velocity times (2 m / 4 m - 1): a weakness that its stated error includes.
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
        assert "σ above" in o.reason
    assert len({o.id for s in seen[4:] for o in s.reported if o.position_camera[2] < 2.3}) == 1


def test_the_interval_chooses_the_pair_and_dt_is_measured() -> None:
    parameters = PLANAR.changed({"frames.interval": 3})
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


def test_a_frame_without_a_pose_keeps_the_last_known_place_of_the_camera() -> None:
    """The camera drives ahead; the pair to compare with is five frames, thus 5 cm, earlier."""
    observer = Observer(CALIBRATION, PLANAR.changed({"frames.interval": 5}))
    sequence = frames(9, board_speed=0.3, camera_velocity=(0.0, 0.0, 0.15))
    seen = observe_all(observer, [*sequence[:-1], black(sequence[-1])])
    assert seen[-1].T_world_camera is None
    (before,), (lost,) = seen[-2].reported, seen[-1].reported
    assert lost.state is TrackState.COASTING
    assert lost.position_camera[2] == pytest.approx(before.position_camera[2], abs=0.01)


def test_every_step_is_in_the_trace_and_consistent_with_the_others() -> None:
    sequence = frames(6, camera_velocity=(0.1, 0.0, 0.0))
    observer = Observer(CALIBRATION, preset("paper"))
    observe_all(observer, sequence[:5])
    trace = FullTrace()
    observer.observe(sequence[5], trace)
    np.testing.assert_array_equal(trace["previous_left"], sequence[4].left)
    assert trace["points_previous"].shape == trace["points_current"].shape
    assert len(trace["points_previous"]) > 0
    assert set(trace["decomposition"]) == {"translation_px", "rotation_rad", "shear", "scale"}


def test_velocity_is_the_raw_displacement_over_dt_without_filtering() -> None:
    """Reports follow each frame's detection; nothing is filtered over time."""
    observer = Observer(CALIBRATION, preset("paper"))
    sequence = frames(8)
    observe_all(observer, sequence[:7])
    trace = FullTrace()
    (board,) = observer.observe(sequence[7], trace).reported
    (detection,) = trace["detections"]
    motions = trace["motions"]
    moved = motions.points_current - motions.points_previous
    np.testing.assert_allclose(board.velocity_camera, detection.velocity, atol=1e-12)
    assert np.abs(np.median(moved, axis=0) / DT - detection.velocity).max() < 0.1


DETECTORS = ["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb"]


@pytest.mark.parametrize(
    ("detector", "method"), list(itertools.product(DETECTORS, ["descriptor", "klt"]))
)
def test_every_detector_and_matching_finds_the_board(detector: str, method: str) -> None:
    parameters = PLANAR.changed(
        {"features.detector": detector, "matching.method": method, "tracking.confirm_hits": 1}
    )
    seen = observe_all(Observer(CALIBRATION, parameters), frames(3, board_speed=0.5))
    board = [o for o in seen[-1].reported if abs(o.position_camera[2] - 2.0) < 0.3]
    assert len(board) == 1
    assert board[0].speed == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("model", ["affine", "homography"])
@pytest.mark.parametrize("matcher", ["bm", "sgbm"])
def test_every_model_and_matcher_finds_the_board(model: str, matcher: str) -> None:
    parameters = PLANAR.changed(
        {"ego_motion.model": model, "stereo.matcher": matcher, "tracking.confirm_hits": 1}
    )
    sequence = frames(3, board_speed=0.5, camera_velocity=(0.1, 0, 0.1))
    seen = observe_all(Observer(CALIBRATION, parameters), sequence)
    (board,) = seen[-1].reported
    assert board.speed == pytest.approx(0.5, abs=0.1)
