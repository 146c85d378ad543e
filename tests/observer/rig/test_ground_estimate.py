"""The floor from clouds with known planes, and from rendered pairs through the stereo stage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from observer.camera import StereoCamera, as_gray
from observer.geometry import Float64Array
from observer.mount import CameraMount
from observer.parameters import StereoParameters
from observer.rig import ground_estimate
from observer.rig.estimates import Refused
from observer.rig.ground_estimate import GroundEstimate, estimate_ground
from observer.rig.ground_views import ground_points
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import Scenario, load_scenario
from observer.simulation.world import World
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
# Pixels: the largest disparity that is searched.
MOST_DISPARITY = 95.0
EVERYWHERE = ((-50.0, 50.0), (-50.0, 50.0))


@dataclass(frozen=True)
class Level:
    """A level surface at z, bounded along x (ahead) and y (left), metres above the floor."""

    z: float
    x: tuple[float, float] = EVERYWHERE[0]
    y: tuple[float, float] = EVERYWHERE[1]
    slope: float = 0.0


def cloud(
    mount: CameraMount,
    surfaces: tuple[Level, ...] = (Level(0.0),),
    wall_x: float = 5.0,
    noise: float = 0.2,
    bias: float = 0.0,
    seed: int = 0,
) -> Float64Array:
    """Points of a dense disparity on every second pixel: the nearest surface along each ray."""
    v, u = np.mgrid[0 : CAMERA.height : 2, 0 : CAMERA.width : 2]
    px = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    ray = np.column_stack([(px - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(len(px))])
    T = mount.T_level_camera
    ahead, left, up = T.rotate(ray).T
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(ahead > 0, wall_x / ahead, np.inf)
        for s in surfaces:
            z = (s.z - mount.height_m) / (up - s.slope * ahead)
            x, y = z * ahead, z * left
            hit = (z > 0) & (x > s.x[0]) & (x < s.x[1]) & (y > s.y[0]) & (y < s.y[1])
            depth = np.where(hit & (z < depth), z, depth)
    rng = np.random.default_rng(seed)
    disparity = CAMERA.fx * CAMERA.baseline / depth + bias + noise * rng.standard_normal(len(px))
    wrong = disparity > MOST_DISPARITY
    disparity[wrong] = rng.uniform(5, MOST_DISPARITY, int(wrong.sum()))
    points: Float64Array = CAMERA.triangulate(px, disparity)
    return points


def found(answer: GroundEstimate | Refused) -> GroundEstimate:
    assert isinstance(answer, GroundEstimate), answer
    return answer


def refused(answer: GroundEstimate | Refused) -> str:
    assert isinstance(answer, Refused), answer
    return answer.sentence


def assert_is(estimate: GroundEstimate, mount: CameraMount, height: float = 0.01) -> None:
    assert estimate.height_m.value == pytest.approx(mount.height_m, abs=height)
    assert estimate.tilt_rad.value == pytest.approx(mount.tilt_rad, abs=math.radians(0.3))
    assert estimate.roll_rad.value == pytest.approx(mount.roll_rad, abs=math.radians(0.3))


@pytest.mark.parametrize(
    "mount",
    [
        CameraMount(0.25, 0.0),
        CameraMount(0.4, math.radians(5), roll_rad=math.radians(2)),
        CameraMount(0.6, math.radians(20), roll_rad=math.radians(-3)),
        CameraMount(0.25, math.radians(20)),
    ],
)
def test_the_floor_is_found_with_its_uncertainty(mount: CameraMount) -> None:
    estimate = found(estimate_ground([cloud(mount)], CAMERA))
    assert_is(estimate, mount, height=0.002)
    assert 0 < estimate.height_m.sigma < 0.01
    assert abs(estimate.height_m.value - mount.height_m) < 2 * estimate.height_m.sigma
    np.testing.assert_allclose(estimate.mount.down, mount.down, atol=2e-3)


def test_the_floor_is_found_beneath_a_larger_table() -> None:
    mount = CameraMount(0.6, math.radians(15))
    table = Level(0.25, (0.5, 2.6), (-0.7, 2.0))
    view = cloud(mount, (Level(0.0), table))
    on_table = np.abs(mount.T_level_camera.apply(view)[:, 2] - 0.25) < 0.02
    on_floor = np.abs(mount.T_level_camera.apply(view)[:, 2]) < 0.02
    assert on_table.sum() > on_floor.sum()
    assert_is(found(estimate_ground([view], CAMERA)), mount)


def test_the_top_of_a_box_hiding_the_floor_is_refused() -> None:
    mount = CameraMount(0.6, math.radians(5))
    box = Level(0.3, (1.0, 1.8))
    view = cloud(mount, (box,))
    assert "beneath it, so it is not the floor" in refused(estimate_ground([view], CAMERA))


def test_a_view_of_walls_alone_is_refused() -> None:
    mount = CameraMount(0.4, 0.0)
    sentence = refused(estimate_ground([cloud(mount, (), wall_x=0.9)], CAMERA))
    assert "no level plane is visible below the camera" in sentence


def test_a_ceiling_is_not_a_floor() -> None:
    mount = CameraMount(0.4, math.radians(-20))
    view = cloud(mount, (Level(2.0),), wall_x=8.0)
    assert (mount.T_level_camera.apply(view)[:, 2] > 1.9).sum() > 2000
    assert "no level plane" in refused(estimate_ground([view], CAMERA))


@pytest.mark.parametrize("slope", [-0.12, 0.12])
def test_a_ramp_beside_the_floor_is_ambiguous(slope: float) -> None:
    mount = CameraMount(0.5, math.radians(10))
    floor = Level(0.0, (-50, 50), (0.0, 50.0))
    ramp = Level(0.0, (-50, 50), (-50.0, 0.0), slope=slope)
    sentence = refused(estimate_ground([cloud(mount, (floor, ramp))], CAMERA))
    assert sentence.startswith("two planes could be the floor")


def test_too_few_points_are_refused_with_their_number() -> None:
    view = cloud(CameraMount(0.4, 0.1))[-300:]
    assert refused(estimate_ground([view], CAMERA)).startswith("only 300 points have a depth")
    assert "at least one" in refused(estimate_ground([], CAMERA))


def test_points_without_depth_are_ignored() -> None:
    mount = CameraMount(0.4, 0.1)
    view = cloud(mount)
    view[::3] = np.nan
    assert_is(found(estimate_ground([view], CAMERA)), mount)


def test_a_view_without_floor_is_excluded() -> None:
    mount = CameraMount(0.4, 0.1)
    views = [cloud(mount, seed=k) for k in range(3)]
    views.insert(1, cloud(mount, (), wall_x=0.7))
    estimate = found(estimate_ground(views, CAMERA))
    assert (estimate.views, estimate.views_left_out) == (3, 1)
    assert_is(estimate, mount)
    blind = [cloud(mount, (), wall_x=0.7)] * 3
    assert "no level plane" in refused(estimate_ground([views[0], *blind], CAMERA))


def test_differing_views_increase_the_uncertainty_until_refused() -> None:
    def nodding(degrees: float) -> GroundEstimate | Refused:
        tilts = [math.radians(5 + degrees * k) for k in (-1, 0, 1, -0.7, 0.8)]
        return estimate_ground([cloud(CameraMount(0.4, tilt)) for tilt in tilts], CAMERA)

    assert found(nodding(0.6)).tilt_rad.sigma > 2 * found(nodding(0.0)).tilt_rad.sigma
    assert "the views disagree" in refused(nodding(5))


def test_a_calibration_bias_is_within_the_stated_uncertainty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mount = CameraMount(0.4, math.radians(5))
    for bias in (-0.3, 0.3):
        estimate = found(estimate_ground([cloud(mount, bias=bias)], CAMERA))
        assert abs(estimate.tilt_rad.value - mount.tilt_rad) < 2 * estimate.tilt_rad.sigma
        assert abs(estimate.height_m.value - mount.height_m) < 2 * estimate.height_m.sigma
    monkeypatch.setattr(ground_estimate, "_BIAS_PX", 1.0)
    careful = found(estimate_ground([cloud(mount)], CAMERA))
    assert careful.tilt_rad.sigma > 2 * estimate.tilt_rad.sigma


def test_equal_views_give_identical_estimates() -> None:
    views = [cloud(CameraMount(0.4, 0.1), seed=k) for k in range(2)]
    assert estimate_ground(views, CAMERA) == estimate_ground(views, CAMERA)


def test_the_sentence_uses_centimetres_and_degrees() -> None:
    estimate = found(estimate_ground([cloud(CameraMount(0.4, math.radians(5)))], CAMERA))
    assert "40.0 ± " in estimate.sentence
    assert "tilted down by 5.0 ± " in estimate.sentence


# --- through the simulated cameras and the stereo stage ----------------------------------------


def rendered(
    scenario: str,
    seed: int,
    camera: dict[str, Any],
    frames: tuple[int, ...] = (0, 30),
    **also: Any,
) -> tuple[GroundEstimate | Refused, CameraMount]:
    """The estimate from some frames, and the true mount of the rectified camera."""
    spec = load_scenario(scenario).model_dump()
    spec["camera"].update(camera)
    world = World(Scenario.model_validate({**spec, **also}), seed)
    rectification, imager = Rectification(world.calibration), StereoImager(world)
    views = []
    for index in frames:
        pair = rectification.apply(*imager.pair(index, index / world.scenario.frame_rate))
        left, right = (as_gray(image) for image in pair)
        disparity = disparity_map(left, right, StereoParameters())
        views.append(ground_points(left, disparity, rectification.camera))
    T_base_left = world.T_base_left(0.0)
    down = world.R_camera_left @ T_base_left.rotation.T @ np.array([0, 0, -1.0])
    tilt, roll = CameraMount.angles_of(down)
    true = CameraMount(float(T_base_left.translation[2]), tilt, roll_rad=roll)
    return estimate_ground(views, rectification.camera), true


@pytest.mark.parametrize(
    ("scenario", "seed", "camera"),
    [
        ("lateral", 0, {"height_m": 0.25, "tilt_deg": 20}),
        ("lab", 2, {"height_m": 0.6, "tilt_deg": 10, "width": 640, "height": 480}),
        ("miscalibrated_vergence", 1, {}),
    ],
)
def test_height_and_tilt_of_a_simulated_camera_are_estimated(
    scenario: str, seed: int, camera: dict[str, Any]
) -> None:
    answer, true = rendered(scenario, seed, camera)
    estimate = found(answer)
    assert estimate.height_m.value == pytest.approx(
        true.height_m, abs=min(0.015, 0.02 * true.height_m)
    )
    assert estimate.tilt_rad.value == pytest.approx(true.tilt_rad, abs=math.radians(0.5))
    assert estimate.roll_rad.value == pytest.approx(true.roll_rad, abs=math.radians(0.5))
    for estimated, value in (
        (estimate.height_m, true.height_m),
        (estimate.tilt_rad, true.tilt_rad),
        (estimate.roll_rad, true.roll_rad),
    ):
        assert abs(estimated.value - value) < 3 * estimated.sigma


@pytest.mark.slow
def test_the_simulated_floor_is_found_around_a_large_crate() -> None:
    crate = {"kind": "crate", "x": 1.6, "y": 0, "size": [1.6, 2.6, 0.2]}
    answer, true = rendered(
        "lab", 0, {"height_m": 0.5, "tilt_deg": 15}, (0,), objects=[crate], robots=[]
    )
    assert_is(found(answer), true)


def test_a_simulated_cabinet_that_hides_the_floor_is_refused() -> None:
    cabinet = {"kind": "cabinet", "x": 1.1, "y": 0, "size": [0.5, 3, 1.5]}
    answer, _ = rendered("lab", 0, {"tilt_deg": 0}, (0,), objects=[cabinet], robots=[])
    assert "no level plane" in refused(answer)
