"""From image pairs to evidence: depth, ground and free space together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED, UNKNOWN
from observer.methods.rigid.dense.scene import DenseScene, DenseVision
from observer.parameters import DenseParameters, StereoParameters
from observer.vision.camera_rate import CameraRate
from observer.vision.view import View

from ....builders import Texture, as_image
from ..solid_worlds import CAMERA, HERE, MOUNT, seen, step_to

P = StereoParameters()
SHAPE = (CAMERA.height, CAMERA.width)
WALL, PERSON = Texture(1, SHAPE, finest_px=12.0), Texture(2, SHAPE, finest_px=12.0)
# Cells on the person, all of them above the horizon.
ON_PERSON = (slice(45, 95), slice(130, 195))


def view(index: int, person: bool) -> View:
    """A wall at 6 m, with or without a person at 3 m in front of it."""
    left, right = as_image(WALL.moved(), 1.0, 3 * index), as_image(WALL.moved(-10.0), 1.0, index)
    if person:
        thing = as_image(PERSON.moved(), 1.0, 2 * index)[80:200, 250:400]
        left[80:200, 250:400] = right[80:200, 230:380] = thing
    return View(index, 0.4 * index, None, left, right)


@pytest.fixture(scope="module")
def scenes() -> list[DenseScene]:
    """The wall alone, with a person, and alone again."""
    vision = DenseVision(CAMERA, MOUNT)
    return [vision.look(view(k, k == 1), step_to(dt=0.4), P, 0.0) for k in range(3)]


def test_the_first_frame_has_depth_but_no_motion_evidence(scenes: list[DenseScene]) -> None:
    assert np.nanmedian(scenes[0].disparity) == pytest.approx(10.0, abs=0.3)
    assert (scenes[0].evidence == UNKNOWN).all()


def test_an_arriving_person_has_arrived_and_the_wall_beside_is_static(
    scenes: list[DenseScene],
) -> None:
    evidence, standing = scenes[1].evidence, scenes[1].standing
    assert (evidence[ON_PERSON] == ARRIVED).mean() > 0.95
    beside = standing.copy()
    beside[35:105, 115:205] = False
    assert (evidence[beside] == STATIC).mean() > 0.97


def test_background_seen_after_a_person_left_is_uncovered(scenes: list[DenseScene]) -> None:
    assert (scenes[2].evidence[ON_PERSON] == STATIC).mean() > 0.9
    vision = DenseVision(CAMERA, MOUNT)
    vision.look(view(1, True), step_to(dt=0.4), P, 0.0)
    left = vision.look(view(2, False), step_to(dt=0.4), P, 0.0)
    assert (left.evidence[ON_PERSON] == UNCOVERED).mean() > 0.9


def test_only_standing_cells_are_judged(scenes: list[DenseScene]) -> None:
    for scene in scenes:
        assert (scene.evidence[~scene.standing] == UNKNOWN).all()


def test_the_same_images_give_identical_evidence(
    scenes: list[DenseScene],
) -> None:
    vision = DenseVision(CAMERA, MOUNT)
    for k, scene in enumerate(scenes):
        again = vision.look(view(k, k == 1), step_to(dt=0.4), P, 0.0)
        np.testing.assert_array_equal(again.disparity, scene.disparity)
        np.testing.assert_array_equal(again.evidence, scene.evidence)


@settings(max_examples=30)
@given(z=st.floats(0.4, 10.0))
def test_the_depth_tolerance_is_a_body_thickness_and_never_below_noise(z: float) -> None:
    scene = seen([], HERE)
    focal = CAMERA.fx * CAMERA.baseline
    tolerance = scene.tolerance(focal / z)
    assert tolerance >= 1.3
    if tolerance > 1.3:
        assert tolerance == pytest.approx(focal / z - focal / (z + 0.35), rel=0.9)
    assert scene.tolerance(focal / z) >= scene.tolerance(focal / (z + 1))


def test_the_pose_of_the_scene_is_that_of_the_frame() -> None:
    pose = Pose.from_rotvec([0.0, 0.3, 0.0], [1.0, 0.0, 2.0])
    scene = DenseVision(CAMERA, MOUNT).look(view(0, False), step_to(pose), P, 0.0)
    np.testing.assert_allclose(scene.T_world_camera.matrix, pose.matrix, atol=1e-12)


def test_a_camera_at_road_speed_gives_no_dense_evidence() -> None:
    for speed, known in ((2.0, True), (3.0, False)):
        rate = CameraRate.of(Pose(np.eye(3), np.array([0.0, 0.0, -speed * 0.4])), 0.4)
        step = replace(step_to(dt=0.4), rate=rate)
        assert (DenseVision(CAMERA, MOUNT).look(view(0, False), step, P, 0.0) is not None) is known


@pytest.mark.parametrize(
    ("rate_hz", "looks"), [(60.0, 30), (15.0, 30), (7.5, 15), (5.0, 10), (0.0, 0)]
)
def test_dense_vision_runs_at_the_configured_rate(rate_hz: float, looks: int) -> None:
    vision, dt = DenseVision(CAMERA, MOUNT), 1 / 15
    parameters = DenseParameters(rate_hz=rate_hz)
    blank = np.full((CAMERA.height, CAMERA.width), 128, np.uint8)
    count = 0
    for k in range(30):
        if vision.is_due(k * dt, dt, parameters):
            vision.look(View(k, k * dt, None, blank, blank), step_to(), P, 0.0)
            count += 1
    assert count == looks
