"""From a track to the reported obstacle: world, camera, uncertainty, words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.planar.reporting import describe_obstacle
from observer.methods.planar.results import Detection, Track
from observer.types import Obstacle, TrackState

POSE = Pose.from_rotvec((0.0, np.pi / 2, 0.0), (1.0, 0.0, 2.0))
TIME = 3.0


def track(**changes: Any) -> Track:
    """An obstacle 2 m ahead of the camera that moves to its right at 0.5 m/s."""
    detection = Detection(
        position=np.array([0.0, 0.0, 2.0]),
        position_cov=np.diag([1e-4, 1e-4, 4e-4]),
        velocity=np.array([0.5, 0.0, 0.0]),
        velocity_cov=np.diag([1e-4, 1e-4, 0.04]),
        velocity_time=2.95,
        size=np.array([0.4, 0.3, 0.2]),
        points=12,
        significance=7.5,
        box_px=(1.0, 2.0, 3.0, 4.0),
    )
    return replace(
        Track(
            id=4,
            state=TrackState.CONFIRMED,
            detection=detection,
            position=POSE.apply(detection.position),
            velocity=POSE.rotate(detection.velocity),
            sightings=9,
            missed=0,
        ),
        **changes,
    )


def described(
    of: Track, *, known: bool = True, camera_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Obstacle:
    velocity = np.array(camera_velocity) if known else None
    return describe_obstacle(of, POSE, POSE if known else None, velocity, TIME)


def test_world_and_camera_quantities_are_in_their_frames() -> None:
    o = described(track())
    np.testing.assert_allclose(o.position_camera, (0, 0, 2), atol=1e-12)
    np.testing.assert_allclose(o.velocity_camera, (0.5, 0, 0), atol=1e-12)
    # The camera looks along the world's x axis.
    np.testing.assert_allclose(o.position, (3, 0, 2), atol=1e-12)
    np.testing.assert_allclose(o.velocity, (0, 0, -0.5), atol=1e-12)
    np.testing.assert_allclose(o.velocity_cov, np.diag([0.04, 1e-4, 1e-4]), atol=1e-12)
    np.testing.assert_allclose(o.orientation_wxyz, POSE.quaternion_wxyz)
    assert (o.id, o.points, o.significance, o.velocity_time) == (4, 12, 7.5, 2.95)
    assert o.speed == 0.5


def test_only_camera_quantities_are_known_without_a_pose() -> None:
    o = described(track(), known=False)
    for name in ("position", "velocity", "position_cov", "velocity_cov", "orientation_wxyz"):
        assert getattr(o, name) is None
    assert o.closing_speed is None
    np.testing.assert_allclose(o.position_camera, (0, 0, 2), atol=1e-12)
    assert o.range == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("camera", "obstacle", "closing"),
    [
        ((0, 0, 0.3), (0, 0, 0), 0.3),
        ((0, 0, 0), (0, 0, -0.4), 0.4),
        ((0, 0, 0.3), (0, 0, 0.3), 0.0),
        ((0, 0, 0), (0.5, 0, 0), 0.0),
        ((0, 0, -0.2), (0, 0, 0.1), -0.3),
    ],
)
def test_closing_speed_is_the_rate_at_which_the_range_shrinks(
    camera: tuple[float, float, float], obstacle: tuple[float, float, float], closing: float
) -> None:
    moving = track(velocity=POSE.rotate(np.array(obstacle, float)))
    assert described(moving, camera_velocity=camera).closing_speed == pytest.approx(closing)


def test_a_coasting_obstacle_becomes_less_certain_and_says_why() -> None:
    seen = described(track())
    coasting = described(track(state=TrackState.COASTING, missed=3))
    assert coasting.points == 0
    assert coasting.velocity_time == 2.95
    assert np.trace(coasting.position_cov) > np.trace(seen.position_cov)
    assert coasting.reason.startswith("not seen for 3 frames")
    assert "12 points moved at 0.50 m/s, 7.5 σ" in seen.reason


def test_an_unknown_uncertainty_stays_unknown() -> None:
    unknown = track(detection=replace(track().detection, velocity_cov=None))
    o = described(unknown)
    assert o.speed_std is None
    assert o.velocity_cov is None
    assert o.velocity is not None
