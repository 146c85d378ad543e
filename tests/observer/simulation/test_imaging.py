"""The cameras' faults, each measured on the images they produce."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from observer.simulation import rendering
from observer.simulation.facets import Facet
from observer.simulation.imaging import LEFT, RIGHT, StereoImager
from observer.simulation.scenarios import load_scenario, scenario_names
from observer.simulation.source import SimulatedSource
from observer.simulation.specs.cameras import FaultSpec
from observer.simulation.textures import paint
from observer.simulation.world import World

from .pixel_truth import left_hits

BENCHMARK = [name for name in scenario_names() if load_scenario(name).benchmark]


def world_with(name: str = "lateral", **faults: Any) -> World:
    scenario = load_scenario(name)
    return World(scenario.model_copy(update={"faults": FaultSpec.model_validate(faults)}))


def gray(image: np.ndarray) -> np.ndarray:
    """Return unrounded grey values."""
    return image.astype(float) @ np.array([0.114, 0.587, 0.299])


def test_noise_has_the_stated_strength_and_is_independent() -> None:
    world = world_with(noise=2.0)
    imager = StereoImager(world)
    clean = gray(imager.clean(LEFT, 1.0)), gray(imager.clean(RIGHT, 1.0))
    noise = []
    for index in (15, 16):
        left, right = imager.pair(index, 1.0)
        noise += [gray(left) - clean[0], gray(right) - clean[1]]
    for n in noise:
        assert abs(n.mean()) < 0.1
        assert n.std() == pytest.approx(2.0, abs=0.15)
    for a in range(4):
        for b in range(a):
            assert abs(np.corrcoef(noise[a].ravel(), noise[b].ravel())[0, 1]) < 0.02
    # White noise: neighbouring pixels are independent.
    assert abs(np.corrcoef(noise[0][:, 1:].ravel(), noise[0][:, :-1].ravel())[0, 1]) < 0.02


def test_the_right_camera_is_brighter_by_the_gain() -> None:
    plain, bright = (StereoImager(world_with(gain=g)).pair(0, 0.0) for g in (0.0, 0.05))
    assert np.array_equal(plain[0], bright[0])
    assert gray(bright[1]).mean() / gray(plain[1]).mean() == pytest.approx(1.05, abs=0.005)


def test_flicker_changes_the_brightness_over_time() -> None:
    world = world_with("static_turning", flicker={"amplitude": 0.1, "hz": 2.0})
    imager, steady = StereoImager(world), StereoImager(world_with("static_turning"))
    # At a quarter and three quarters of the period: brightest and darkest.
    for t, factor in ((0.125, 1.1), (0.375, 0.9)):
        ratio = gray(imager.pair(0, t)[0]).mean() / gray(steady.pair(0, t)[0]).mean()
        assert ratio == pytest.approx(factor, abs=0.01)


def test_exposure_settles_at_first_and_again_when_the_light_is_switched() -> None:
    settling = {"gain": 1.4, "time_s": 0.5, "again_s": [3.0, 5.0]}
    world, steady = world_with("static_turning", settling=settling), world_with("static_turning")
    assert world.brightness(0.0) == pytest.approx(1.4)
    assert world.brightness(0.5) == pytest.approx(1 + 0.4 / math.e)
    assert world.brightness(2.9) == pytest.approx(1.0, abs=0.002)
    for switched in (3.0, 5.0):
        assert world.brightness(switched) == pytest.approx(1.4)
        assert world.brightness(switched + 0.5) == pytest.approx(1 + 0.4 / math.e)
    assert steady.brightness(0.0) == 1.0
    imager, plain = StereoImager(world), StereoImager(steady)
    for side in (LEFT, RIGHT):
        ratio = gray(imager.pair(8, 0.5)[side]).mean() / gray(plain.pair(8, 0.5)[side]).mean()
        assert ratio == pytest.approx(1 + 0.4 / math.e, abs=0.01)


def test_the_settling_scene_saturates_at_first_and_at_the_switch() -> None:
    imager = StereoImager(World(load_scenario("static_settling")))

    def saturated(time: float) -> float:
        return float((imager.pair(0, time)[0].min(axis=2) == 255).mean())

    assert saturated(0.0) > 0.25
    assert saturated(5.0) > 0.25
    assert saturated(4.0) < 0.02


def sharpness(image: np.ndarray) -> float:
    return float(np.abs(cv2.Laplacian(gray(image), cv2.CV_64F)).mean())


def test_blur_and_exposure_time_smear_the_image() -> None:
    sharp = StereoImager(world_with("rotating")).clean(LEFT, 1.0)
    blurred = StereoImager(world_with("rotating", blur_px=1.5)).pair(15, 1.0)[0]
    assert sharpness(blurred) < 0.5 * sharpness(sharp)
    exposed = StereoImager(world_with("rotating", exposure_s=0.04)).clean(LEFT, 1.0)
    gradient = [np.abs(np.diff(gray(i), axis=1)).mean() for i in (sharp, exposed)]
    across = [np.abs(np.diff(gray(i), axis=0)).mean() for i in (sharp, exposed)]
    # The camera turns about the vertical axis, so the blur is horizontal.
    assert gradient[1] < 0.75 * gradient[0]
    assert gradient[1] / gradient[0] < 0.9 * across[1] / across[0]


def test_skew_shifts_the_instant_of_the_right_image() -> None:
    skewed, steady = world_with(skew_s=0.016), world_with()
    assert np.array_equal(
        StereoImager(skewed).pair(0, 1.0)[1], StereoImager(steady).clean(RIGHT, 1.016)
    )
    frames = [SimulatedSource(world).read() for world in (skewed, steady)]
    assert frames[0] is not None
    assert frames[1] is not None
    assert frames[0].right_time == pytest.approx(0.016)
    assert frames[1].right_time is None


def test_unknown_skew_shows_only_in_the_images() -> None:
    known, unknown = (world_with(skew_s=0.016, skew_known=known) for known in (True, False))
    frames = [SimulatedSource(world).read() for world in (known, unknown)]
    assert frames[0] is not None
    assert frames[1] is not None
    assert np.array_equal(frames[0].right, frames[1].right)
    assert frames[0].right_time == pytest.approx(0.016)
    assert frames[1].right_time is None
    assert not load_scenario("static_skew").faults.skew_known


def test_the_vergence_scene_biases_every_disparity_equally() -> None:
    world = World(load_scenario("static_vergence"))
    true, said = world.true_calibration, world.calibration
    for point in ([0.0, 0.0, 1.5], [0.4, 0.2, 3.0], [-1.0, -0.3, 6.0]):
        left = np.array(point)
        right = said.R.T @ (true.R @ left + true.T)
        disparity = true.K1[0, 0] * (left[0] / left[2] - right[0] / right[2])
        bias = disparity - true.K1[0, 0] * true.baseline / left[2]
        assert abs(bias) == pytest.approx(0.6, abs=0.05)


def test_a_rolling_shutter_reads_each_row_at_its_own_time() -> None:
    readout = 0.1
    rolling = StereoImager(world_with("rotating", readout_s=readout))
    steady = StereoImager(world_with("rotating"))
    image = gray(rolling.clean(LEFT, 1.0))
    for row in (8, 120, 248):
        # Rows are read in strips of 16; this is the time of the strip's middle.
        strip = slice(row // 16 * 16, row // 16 * 16 + 16)
        instant = 1.0 + readout * ((strip.start + 7.5) / 255 - 0.5)
        assert np.array_equal(image[strip], gray(steady.clean(LEFT, instant))[strip])
    assert not np.array_equal(image[:16], gray(steady.clean(LEFT, 1.0))[:16])


def test_a_distorted_tilted_rig_is_rectified_by_its_calibration() -> None:
    """Rows agree after rectification with the published calibration, and not before."""
    world = World(
        load_scenario("distorted_tilted").model_copy(
            update={"faults": load_scenario("distorted_tilted").faults.model_copy(
                update={"noise": 0.0})}
        )
    )  # fmt: skip
    left, right = StereoImager(world).pair(0, 0.0)
    assert _vertical_error(left, right) > 1.0
    c = world.calibration
    size = (c.width, c.height)
    R1, R2, P1, P2 = cv2.stereoRectify(c.K1, c.D1, c.K2, c.D2, size, c.R, c.T, alpha=0)[:4]
    assert np.allclose(R1, world.R_camera_left)
    rectified = []
    for image, K, D, R, P in ((left, c.K1, c.D1, R1, P1), (right, c.K2, c.D2, R2, P2)):
        maps = cv2.initUndistortRectifyMap(K, D, R, P, size, cv2.CV_32FC1)
        rectified.append(cv2.remap(image, *maps, cv2.INTER_LINEAR))
    assert _vertical_error(*rectified) < 0.2


def _vertical_error(left: np.ndarray, right: np.ndarray) -> float:
    a, b = (cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in (left, right))
    start = cv2.goodFeaturesToTrack(a, 200, 0.02, 8)
    found, ok, _ = cv2.calcOpticalFlowPyrLK(a, b, start, None, winSize=(15, 15))
    good = ok.ravel() == 1
    return float(np.median(np.abs(found[good, 0, 1] - start[good, 0, 1])))


def test_only_miscalibrated_scenarios_provide_a_wrong_calibration() -> None:
    for name in scenario_names():
        world = World(load_scenario(name))
        same = world.calibration is world.true_calibration
        said_wrong = name.startswith("miscalibrated") or name == "static_vergence"
        assert same == (not said_wrong), name
    world = World(load_scenario("miscalibrated"))
    true, said = world.true_calibration, world.calibration
    assert said.K1[0, 0] / true.K1[0, 0] == pytest.approx(1.005)
    angle = np.degrees(np.linalg.norm(cv2.Rodrigues(said.R @ true.R.T)[0]))
    assert angle == pytest.approx(0.2 * np.sqrt(2), rel=0.01)
    assert said.baseline == pytest.approx(true.baseline)


def test_equal_seeds_give_identical_images_and_others_differ(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def frames(seed: int) -> list[np.ndarray]:
        source = SimulatedSource(World(load_scenario("lab"), seed))
        images = []
        for _ in range(3):
            frame = source.read()
            assert frame is not None
            images += [frame.left, frame.right]
        return images

    first, other = frames(3), frames(4)
    # Tests share painted textures; this world paints its own.
    monkeypatch.setattr(rendering, "paint", paint)
    again = frames(3)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert np.abs(first[0].astype(int) - other[0]).mean() > 5


def test_painting_depends_on_the_seed_alone() -> None:
    kinds: dict[str, Facet] = {}
    for world in (World(load_scenario("lab")), World(load_scenario("lateral"))):
        facets = [*world.room.facets, *world.posters]
        facets += [f for body in world.bodies for part in body.parts for f in part.facets]
        kinds |= {each.material.kind: each for each in facets}
    assert len(kinds) > 10
    for facet in kinds.values():
        one, again = (paint(facet.material, facet.extent) for _ in range(2))
        assert np.array_equal(one.finest.image, again.finest.image)
    floor = world.room.facets[5]
    one, other = (paint(replace(floor.material, seed=seed), floor.extent) for seed in (7, 77))
    assert not np.array_equal(one.finest.image, other.finest.image)


def test_two_frames_have_different_noise() -> None:
    imager = StereoImager(world_with("static_turning", noise=2.0))
    assert not np.array_equal(imager.pair(0, 0.0)[0], imager.pair(1, 0.0)[0])


@pytest.mark.parametrize("name", BENCHMARK)
def test_at_least_30_percent_of_each_benchmark_scene_has_no_texture(name: str) -> None:
    """Measured on the images: 7-pixel windows whose contrast drowns in the noise."""
    scenario = load_scenario(name)
    for seed in (0, 4):
        world = World(scenario, seed)
        imager = StereoImager(world)
        for t in (0.0, scenario.duration_s / 2):
            image = gray(imager.clean(LEFT, t))
            mean = cv2.boxFilter(image, -1, (7, 7))
            spread = np.sqrt(np.maximum(cv2.boxFilter(image * image, -1, (7, 7)) - mean**2, 0))
            assert (spread < scenario.faults.noise).mean() >= 0.30, f"seed {seed}, {t} s"


def test_benchmark_robots_are_dark_and_weakly_textured() -> None:
    world = World(load_scenario("lateral"))
    image = gray(StereoImager(world).clean(LEFT, 3.0))
    robot = left_hits(world, 3.0).body == world.obstacles[0].id
    core = cv2.erode(robot.astype(np.uint8), np.ones((5, 5))) > 0
    assert core.sum() > 400
    assert image[core].mean() < 60
    assert image[core].std() < 12
