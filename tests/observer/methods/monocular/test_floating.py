from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.monocular.floating import floating, off_ground
from observer.methods.monocular.ground import GroundPlane, GroundView
from observer.methods.monocular.inverse_depth import lines_of_sight
from observer.methods.monocular.rays import RayPoints
from observer.mount import CameraMount
from observer.parameters import MonocularParameters

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
FLOOR = GroundPlane.below(CameraMount(0.4, np.radians(5)))
VIEW = GroundView(FLOOR, Pose.identity(), CAMERA)


def box_at(ahead: float, nearer: float) -> tuple[RayPoints, np.ndarray]:
    """A dark box on the ground whose points appear ``nearer`` times nearer than they are."""
    foot = FLOOR.axes @ [0.0, ahead] + FLOOR.depth * FLOOR.down
    u, v = CAMERA.project(foot)[0]
    half, tall = 0.2 * 443 / ahead, 0.3 * 443 / ahead
    image = np.full((256, 512), 150, np.uint8)
    image[int(v - tall) : round(float(v)), int(u - half) : int(u + half)] = 40
    grid = np.stack(
        np.meshgrid(np.linspace(u - half, u + half, 4), np.linspace(v - tall, v - 2, 4)), axis=-1
    )
    px = grid.reshape(-1, 2).astype(np.float32)
    ray = lines_of_sight(px, Pose.identity(), CAMERA)
    inverse = np.full(len(px), nearer / np.linalg.norm(foot))
    points = RayPoints.begin(px, np.zeros(3), ray, inverse, (0.02 * inverse) ** 2)
    return points.but(age_s=np.ones(len(px))), image


@pytest.mark.parametrize(("nearer", "floats"), [(1.0, False), (1.5, False), (3.3, True)])
def test_an_object_much_nearer_than_its_foot_floats(nearer: float, floats: bool) -> None:
    points, image = box_at(4.0, nearer)
    _, inverse = off_ground(points, VIEW)
    groups, significance = floating(
        points, np.zeros(len(points), np.int64), inverse, image, VIEW,
        MonocularParameters(),
    )  # fmt: skip
    assert (groups >= 0).all() == floats
    assert (significance > 3).all() == floats


def test_points_on_the_floor_are_not_off_the_ground() -> None:
    rng = np.random.default_rng(0)
    px = np.column_stack([rng.uniform(50, 450, 40), rng.uniform(150, 240, 40)]).astype(np.float32)
    ray = lines_of_sight(px, Pose.identity(), CAMERA)
    inverse = FLOOR.inverse_distance(np.zeros(3), ray) * rng.uniform(0.9, 1.1, 40)
    points = RayPoints.begin(px, np.zeros(3), ray, inverse, (0.01 * inverse) ** 2)
    clear, _ = off_ground(points.but(age_s=np.ones(40)), VIEW)
    assert not clear.any()


def test_an_object_beyond_the_floor_in_reach_is_ignored() -> None:
    points, image = box_at(9.0, 3.3)
    _, inverse = off_ground(points, VIEW)
    groups, _ = floating(
        points, np.zeros(len(points), np.int64), inverse, image, VIEW,
        MonocularParameters(),
    )  # fmt: skip
    assert (groups == -1).all()
