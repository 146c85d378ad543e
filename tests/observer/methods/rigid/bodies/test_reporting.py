"""The report of an obstacle, against a fully known body."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.reporting import describe_body
from observer.methods.rigid.bodies.shape import Box
from observer.types import MotionState, TrackState

# The camera stands a metre to the right and looks 30 degrees to the right.
T_WORLD_CAMERA = Pose.from_rotvec((0, np.radians(30), 0), (1.0, 0.0, 0.2))
SIZE = np.array([0.4, 0.3, 0.6])
STILL = np.zeros(3)


@pytest.fixture
def track(make_track: Callable[..., BodyTrack]) -> BodyTrack:
    made = make_track(
        (0.5, 0.1, 4.0), (0.3, 0.0, -0.4), number=7, yaw=0.2, yaw_rate=0.5,
        box=Box(np.array([0.1, 0.0, 0.2]), SIZE, 0.6),
    )  # fmt: skip
    made.state, made.motion = TrackState.CONFIRMED, MotionState.MOVING
    made.points, made.significance, made.age_s = 14, 12.3, 2.46
    made.box_px = (10.0, 20.0, 60.0, 90.0)
    return made


def test_world_and_camera_coordinates_agree(track: BodyTrack) -> None:
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert o.position is not None
    assert o.velocity is not None
    np.testing.assert_allclose(o.position, [0.5, 0.1, 4.0] + yaw_matrix(0.2) @ [0.1, 0, 0.2])
    np.testing.assert_allclose(T_WORLD_CAMERA.apply(o.position_camera), o.position)
    np.testing.assert_allclose(T_WORLD_CAMERA.rotate(o.velocity_camera), o.velocity)
    arm = o.position - [0.5, 0.1, 4.0]
    np.testing.assert_allclose(o.velocity, np.array([0.3, 0, -0.4]) + np.cross([0, 0.5, 0], arm))
    assert o.speed == pytest.approx(np.linalg.norm(o.velocity))
    assert o.range == pytest.approx(np.linalg.norm(o.position - T_WORLD_CAMERA.translation))


def test_track_values_are_passed_on(track: BodyTrack) -> None:
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert (o.id, o.state, o.motion) == (7, TrackState.CONFIRMED, MotionState.MOVING)
    assert (o.points, o.significance, o.box_px) == (14, 12.3, (10.0, 20.0, 60.0, 90.0))
    # A filtered velocity is valid at the frame, not midway between two frames.
    assert o.velocity_time == 3.5
    np.testing.assert_array_equal(o.size, SIZE)


def test_the_orientation_is_that_of_the_box(track: BodyTrack) -> None:
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert o.orientation_wxyz is not None
    R = Pose.from_quaternion(o.orientation_wxyz, np.zeros(3)).rotation
    np.testing.assert_allclose(R, yaw_matrix(0.2 + 0.6), atol=1e-12)
    # Together with the size it reproduces the body's corners.
    unit = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    np.testing.assert_allclose(
        np.sort(o.position + unit * o.size / 2 @ R.T, axis=0), np.sort(track.corners(), axis=0)
    )


def test_speed_uncertainty_is_that_of_the_velocity_along_its_direction(track: BodyTrack) -> None:
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert o.velocity is not None
    assert o.velocity_cov is not None
    _, cov = track.centre_velocity()
    np.testing.assert_array_equal(o.velocity_cov, cov)
    drawn = np.random.default_rng(0).multivariate_normal(o.velocity, o.velocity_cov, 20000)
    assert o.speed_std == pytest.approx(np.std(np.linalg.norm(drawn, axis=1)), rel=0.05)


def test_position_uncertainty_grows_with_the_box_size(track: BodyTrack) -> None:
    small = describe_body(track, T_WORLD_CAMERA, STILL, 3.5).position_cov
    assert track.box is not None
    track.box = Box(track.box.centre, 3 * SIZE, 0.6)
    large = describe_body(track, T_WORLD_CAMERA, STILL, 3.5).position_cov
    assert small is not None
    assert large is not None
    own = track.filter.covariance[:3, :3]
    assert (np.linalg.eigvalsh(small - own) > 0).all()
    np.testing.assert_allclose(large - own, 9 * (small - own), rtol=1e-9)
    # most along the box's long side
    long, across = (yaw_matrix(0.8) @ axis for axis in ([0, 0, 1.0], [1.0, 0, 0]))
    assert long @ small @ long > 1.5 * across @ small @ across


@pytest.mark.parametrize("camera_speed", [0.0, 0.5])
def test_the_closing_speed_is_the_rate_at_which_the_range_shrinks(
    track: BodyTrack, camera_speed: float
) -> None:
    own = np.array([0.1, 0.0, camera_speed])
    o = describe_body(track, T_WORLD_CAMERA, own, 3.5)
    assert o.position is not None
    assert o.velocity is not None
    dt = 1e-5
    later = o.position + dt * o.velocity
    eye = T_WORLD_CAMERA.translation + dt * T_WORLD_CAMERA.rotate(own)
    assert o.closing_speed == pytest.approx((o.range - np.linalg.norm(later - eye)) / dt, abs=1e-4)


def test_the_reason_explains_why_a_body_is_dynamic(track: BodyTrack) -> None:
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert "14 feature points" in o.reason
    assert f"{o.speed:.2f} m/s" in o.reason
    assert "12.3 σ above zero" in o.reason
    assert "2.5 s" in o.reason
    assert "not seen" not in o.reason


def test_a_body_moving_in_place_is_reported_as_such(track: BodyTrack) -> None:
    track.rigid, track.motion = False, MotionState.IN_PLACE
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert o.motion is MotionState.IN_PLACE
    assert "moves in place" in o.reason


def test_the_reason_of_a_coasting_body_states_how_long_it_was_unseen(track: BodyTrack) -> None:
    track.state, track.missed_s = TrackState.COASTING, 0.74
    o = describe_body(track, T_WORLD_CAMERA, STILL, 3.5)
    assert o.reason.startswith("not seen for 0.7 s")
    assert "14 feature points" in o.reason


def test_a_body_exactly_at_rest_has_finite_values(
    make_track: Callable[..., BodyTrack],
) -> None:
    still = make_track(velocity=(0, 0, 0))
    still.box = None
    o = describe_body(still, Pose.identity(), STILL, 0.0)
    assert o.speed == 0
    assert o.closing_speed == 0
    assert o.speed_std == pytest.approx(0.01 * 3**0.5)
    np.testing.assert_array_equal(o.size, 0)
    assert o.orientation_wxyz is not None
    np.testing.assert_allclose(o.orientation_wxyz, [1, 0, 0, 0])


def test_a_body_at_the_camera_has_a_finite_closing_speed(
    make_track: Callable[..., BodyTrack],
) -> None:
    o = describe_body(make_track((0, 0, 0)), Pose.identity(), STILL, 0.0)
    assert o.range == 0
    assert np.isfinite(o.closing_speed)
