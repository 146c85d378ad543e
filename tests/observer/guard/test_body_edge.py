"""The guard keeps clear of a body's nearest edge, whichever part of the body was measured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from app.drive.separation import separation
from observer.geometry import Float64Array
from observer.guard.outline import Outline
from observer.guard.parameters import GuardParameters
from observer.guard.seeing import seen_obstacles, sight_of_observation
from observer.guard.separation import approach
from observer.guard.sight import SeenObstacle
from observer.methods.rigid.bodies.reporting import describe_body
from observer.robots.contract import RobotPhase, RobotReport
from observer.types import Observation, Obstacle, Status, TrackState

from ..builders import an_obstacle
from ..methods.rigid.solid_worlds import CAMERA, HERE, MOUNT, ROOM, Solid, SolidView, on_floor

# Metres: width, height and depth along the line of sight.
PERSON = (0.5, 1.7, 0.3)
ROBOT = RobotReport(RobotPhase.CONNECTED, length_m=0.5, width_m=0.4)


def person(z: float, x: float = 0.0) -> Solid:
    return on_floor(x, z, PERSON)


def obstacle(x: float, y: float, **changes: object) -> Obstacle:
    """Return a standing obstacle at (x, y) m in the base frame, of known size and position."""
    position = MOUNT.T_base_camera.inverse().apply(np.array([x, y, 0.85]))
    given = {
        "position_camera": position, "position": position, "velocity": np.zeros(3),
        "position_cov": np.zeros((3, 3)), "velocity_cov": np.zeros((3, 3)),
        "size": np.array(PERSON), "orientation_wxyz": np.array([1.0, 0.0, 0.0, 0.0]),
    }  # fmt: skip
    return an_obstacle(**{**given, **changes})


def observation(*obstacles: Obstacle) -> Observation:
    return Observation(3, 1.0, 100.0, 0, Status.OK, (), 0, HERE, obstacles)


def seen_from(one: Obstacle) -> SeenObstacle:
    (seen,) = seen_obstacles(observation(one), CAMERA, MOUNT)
    return seen


def nearest(seen: SeenObstacle) -> float:
    """Return metres from the base's origin to the nearest edge of what the guard is given."""
    return math.hypot(seen.x, seen.y) - seen.radius_m


def corners(x: float, y: float, yaw: float) -> Float64Array:
    """(4, 2) of a person's box on the floor, base frame."""
    half = np.array([[a, b] for a in (-0.15, 0.15) for b in (-0.25, 0.25)])
    c, s = math.cos(yaw), math.sin(yaw)
    return half @ np.array([[c, s], [-s, c]]) + (x, y)


@pytest.mark.parametrize("y", [-1.0, 0.0, 0.6])
def test_the_whole_box_counts_for_any_yaw_of_the_body(y: float) -> None:
    seen = seen_from(obstacle(2.0, y))
    for yaw in np.linspace(0, math.pi, 13):
        edge = np.hypot(*corners(2.0, y, yaw).T).min()
        assert nearest(seen) <= edge
    # At the nearest edge rather than the centre, and hardly nearer than a corner can be.
    assert nearest(seen) == pytest.approx(math.hypot(2.0, y) - 0.3, abs=0.01)


def test_separation_of_a_stopped_robot_ends_at_the_body_edge() -> None:
    sight = sight_of_observation(observation(obstacle(2.0, 0.0)), CAMERA, MOUNT, "real", None, 1.0)
    left = separation(sight, ROBOT, 0.0, 1.0)
    assert left is not None
    assert 1.4 < left <= 2.0 - 0.15 - 0.25


@pytest.mark.parametrize("state", list(TrackState))
def test_a_fragment_of_a_few_points_counts_as_a_person(state: TrackState) -> None:
    # At the edge of a person whose middle is 0.25 m to the side.
    seen = seen_from(obstacle(2.0, 0.25, size=np.full(3, 0.05), state=state))
    assert math.hypot(seen.x - 2.0, seen.y) <= seen.radius_m
    assert nearest(seen) <= 1.85


@pytest.mark.parametrize(("x", "y"), [(2.0, 0.0), (3.0, 0.7), (3.0, -0.7)])
def test_the_silhouette_sets_the_radius_when_points_cover_only_part_of_a_body(
    x: float, y: float
) -> None:
    """A cart is 1.4 m wide: only its right third has points, but its silhouette is complete."""
    one = obstacle(x, y - 0.45, size=np.array([0.4, 0.8, 0.4]))
    edges = MOUNT.T_base_camera.inverse().apply(
        np.array([[x, y + side, height] for side in (-0.7, 0.7) for height in (0.1, 0.9)])
    )
    px, _ = CAMERA.project(edges)
    bare = seen_from(one)
    seen = seen_from(obstacle(x, y - 0.45, size=one.size, silhouette=(px[[0, 1, 3, 2]],)))
    assert seen.radius_m == pytest.approx(0.7 + 0.45, abs=1e-6)
    assert bare.radius_m == pytest.approx(0.3)
    assert (seen.x, seen.y) == (bare.x, bare.y)


def test_a_body_found_by_its_outline_covers_its_nearest_edge() -> None:
    view = SolidView()
    for _ in range(4):
        view.step(ROOM)
    seconds, margins_m = 0, []
    for k in range(25):
        solid = person(2.6, -1.0 + 0.08 * k)
        tracks = view.step([*ROOM, solid])
        reported = [describe_body(t, HERE, np.zeros(3), view.time) for t in tracks]
        seen = seen_obstacles(observation(*reported), CAMERA, MOUNT)
        if not any(not one.coasting for one in seen) or k < 8:
            continue
        seconds += 1
        (one,) = seen
        # x forward, y left of the base; the solid's front is 0.15 m before its middle.
        near = corners(2.6, -solid.centre[0], 0.0)
        assert nearest(one) <= np.hypot(*near.T).min()
        assert np.hypot(*(near - (one.x, one.y)).T).max() <= one.radius_m + 2 * (
            one.position_sigma_m or 0.0
        )
        margins_m.append(np.hypot(*near.T).min() - nearest(one))
    assert seconds > 10
    # Cautious, but not so much that no robot could pass.
    assert np.median(margins_m) < 0.35


def test_the_robot_stops_before_the_edge_and_its_uncertainty() -> None:
    """The robot stops at the same distance as for a point at the body's edge."""
    p, outline, speed = GuardParameters(), Outline.of(0.5, 0.4, None), (0.4, 0.0)
    sigma = 0.1
    cov = np.diag([sigma**2] * 3)

    def is_stopped(one: SeenObstacle) -> bool:
        return approach([one], (0.0, 0.0, 0.0), 0.0, speed, outline, p).stop_share < 1.0

    def first(where: float, radius: float) -> bool:
        return is_stopped(SeenObstacle(1, where, 0.0, 0.0, 0.0, radius, sigma, 0.0, False))

    for x in np.arange(0.6, 2.0, 0.05):
        body = seen_from(obstacle(float(x), 0.0, position_cov=cov))
        assert is_stopped(body) == first(x - body.radius_m, 0.0)
        if is_stopped(body) and not first(float(x), 0.0):
            break
    else:
        pytest.fail("the body's extent makes no difference")
