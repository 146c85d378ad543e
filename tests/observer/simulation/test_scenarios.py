"""Scenarios: the built-in ones, their variation by seed, and one-sentence errors."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.errors import ScenarioError
from observer.simulation.scenarios import (
    Scenario,
    load_scenario,
    scenario_from_text,
    scenario_names,
)
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World

REQUIRED = {
    "lab", "lateral", "away", "toward", "turning", "rotating", "static_turning",
    "parked_beside_moving", "crossing", "stop_and_go", "low_texture_flicker", "distorted_tilted",
    "fast", "vibrating", "skew", "rolling_shutter", "motion_blur", "miscalibrated",
}  # fmt: skip

UNCALIBRATED = ("calibration", "calibration_charuco", "webcams")
SHORT_BASELINE = ("people_short_baseline",)
# Not part of the benchmark.
FOR_SHOWING = ("lab", "drive", *UNCALIBRATED)

MINIMAL = """
title: A title
help: A sentence.
declares: ideal
duration_s: 2
"""
BIG_CHARUCO = """
board: {pattern: charuco, columns: 30, rows: 30, poses: [{centre: [0, 0, 1]}]}
"""


def test_the_required_scenarios_exist_and_the_lab_is_first() -> None:
    names = scenario_names()
    assert names[0] == "lab"
    assert set(names) >= REQUIRED
    assert not any(name.startswith("_") for name in names)


@pytest.mark.parametrize("name", scenario_names())
def test_benchmark_scenes_have_the_declared_difficulty(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.benchmark == (name not in FOR_SHOWING)
    if scenario.benchmark:
        assert scenario.faults.noise == 2.0
        assert scenario.faults.gain == 0.05
        assert scenario.texture.robot == "dark"
    camera = scenario.camera
    if name not in UNCALIBRATED:
        assert (camera.width, camera.height) == (512, 256)
        short = name in SHORT_BASELINE
        assert (camera.baseline_m, camera.hfov_deg) == ((0.075, 70.0) if short else (0.12, 60.0))


def test_uncalibrated_scenes_share_the_cameras_of_the_webcams_scene() -> None:
    webcams = World(load_scenario("webcams")).true_calibration
    for name in UNCALIBRATED:
        scenario = load_scenario(name)
        assert not scenario.hands_out_calibration
        assert SimulatedSource(World(scenario)).calibration is None
        for seed in (0, 3):
            world = World(scenario, seed)
            assert np.array_equal(world.true_calibration.K1, webcams.K1)
            assert np.array_equal(world.true_calibration.D2, webcams.D2)
            assert np.array_equal(world.true_calibration.R, webcams.R)
            assert np.array_equal(world.true_calibration.T, webcams.T)
    assert (webcams.width, webcams.height) == (640, 480)
    assert webcams.D1[:2] == pytest.approx([-0.28, 0.07])
    turned = Rotation.from_matrix(webcams.R).as_euler("xyz", degrees=True)
    assert turned == pytest.approx([0.4, -0.6, 0.3])
    others = set(scenario_names()) - set(UNCALIBRATED)
    assert all(load_scenario(name).hands_out_calibration for name in others)


def test_the_lab_repeats_without_a_visible_seam() -> None:
    world = World(load_scenario("lab"))
    duration = world.scenario.duration_s
    for body in (world.observer, *world.obstacles):
        a, b = body.motion.state(0.0), body.motion.state(duration)
        # A jump at the seam smaller than the motion between frames is not visible.
        assert math.hypot(a.x - b.x, a.y - b.y) < 0.03, body.name
        turned = math.remainder(a.heading - b.heading, 2 * math.pi)
        assert abs(turned) < math.radians(2), body.name


@pytest.mark.parametrize("name", scenario_names())
def test_vehicles_keep_apart_whatever_the_seed(name: str) -> None:
    for seed in (0, 1, 2, 3, 4):
        world = World(load_scenario(name), seed)
        moving = (world.observer, *world.obstacles)
        for k in range(0, math.ceil(world.scenario.duration_s * 4)):
            places = [(b, b.motion.state(k / 4)) for b in (*moving, *world.bodies)]
            for body, s in places[: len(moving)]:
                for other, o in places:
                    if other is body or other.bottom > 0:
                        continue
                    if other.role == "scenery" and body.role == "scenery":
                        continue
                    room = (min(body.size[:2]) + min(other.size[:2])) / 2
                    assert math.hypot(s.x - o.x, s.y - o.y) > room, (
                        f"{name} seed {seed}: {body.name} meets {other.name} at {k / 4} s"
                    )


def test_seed_0_is_the_scenario_as_written_and_others_differ() -> None:
    scenario = load_scenario("lateral")
    assert World(scenario, 0).scenario == scenario
    one, again, two = (World(scenario, seed).scenario for seed in (1, 1, 2))
    assert one == again
    assert one != two
    assert one != scenario
    robot, moved = scenario.robots[0], one.robots[0]
    bounds = scenario.variation
    assert abs(robot.x - moved.x) <= bounds.position_m
    assert abs(robot.heading_deg - moved.heading_deg) <= bounds.heading_deg


def test_waypoints_are_driven_through() -> None:
    text = (
        MINIMAL
        + """
robots:
  - {x: 1, y: 0, motion: {kind: waypoints, points: [[2, 0], [2, 1]], speed: 0.5, after: repeat}}
"""
    )
    world = World(scenario_from_text(text, "tour"))
    motion = world.obstacles[0].motion
    seen = [motion.state(k / 100) for k in range(3000)]
    for x, y in ((1, 0), (2, 0), (2, 1)):
        assert min(math.hypot(s.x - x, s.y - y) for s in seen) < 1e-2
    assert max(math.hypot(s.vx, s.vy) for s in seen) == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (MINIMAL + "colour: red\n", "colour is not a known key"),
        (MINIMAL.replace("ideal", "perfect"), "declares must be 'ideal' or 'faulty'"),
        (MINIMAL + "camera: {hfov_deg: 400}\n", "camera.hfov_deg must be at most"),
        (MINIMAL + "room: {x: [3, 2]}\n", "room.x must span 1 to 60 m"),
        (MINIMAL + "board: {poses: []}\n", "board.poses must not be empty"),
        (MINIMAL + BIG_CHARUCO, "board: a ChArUco board may have at most 500 squares"),
        (MINIMAL + "robots: [{motion: {kind: fly}}]\n", "robots.0.motion"),
        (MINIMAL + "faults: {noise: .nan}\n", "faults.noise must be a finite number"),
        ("title: [\n", "not valid YAML"),
        ("just words\n", "must be a YAML mapping"),
        ("based_on: nowhere\n", "no built-in scenario 'nowhere'"),
        ("based_on: ../lab\n", "no built-in scenario '../lab'"),
    ],
)
def test_a_mistake_is_refused_in_one_sentence_that_names_the_key(text: str, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(text, "mine")
    message = str(caught.value)
    assert says in message
    assert "scenario mine" in message
    assert "\n" not in message


def test_case_does_not_matter_in_a_name() -> None:
    assert load_scenario("LAB").name == load_scenario("lab").name == "lab"


def test_an_unknown_name_is_answered_with_the_nearest_two() -> None:
    for name in ("labb", "LABB"):
        with pytest.raises(
            ScenarioError, match=rf"no scenario '{name}'; did you mean lab or \w+\?"
        ):
            load_scenario(name)
    with pytest.raises(ScenarioError, match=r"did you mean \w+ or \w+\?"):
        load_scenario("§")
    with pytest.raises(ScenarioError, match="no scenario file"):
        load_scenario("/nowhere/mine.yaml")


def test_a_scenario_can_be_loaded_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("based_on: lateral\ntitle: Mine\nfaults: {noise: 0}\n", encoding="utf-8")
    mine, lateral = load_scenario(str(path)), load_scenario("lateral")
    assert mine.name == "mine"
    assert mine.title == "Mine"
    assert mine.robots == lateral.robots
    assert mine.faults.noise == 0
    assert mine.faults.gain == lateral.faults.gain


@pytest.mark.parametrize(
    ("robots", "says"),
    [
        ("{x: 3, motion: {kind: course, legs: [{kind: drive, distance_m: 9, speed: 2}]}}",
         "leaves the room"),
        ("{x: 1, motion: {kind: waypoints, points: [[1, 0]], speed: 1}}", "equals the vehicle"),
        ("{x: 30}", "leaves the room"),
    ],
)  # fmt: skip
def test_impossible_motions_are_refused(robots: str, says: str) -> None:
    scenario = scenario_from_text(
        MINIMAL.replace("duration_s: 2", "duration_s: 9") + f"robots: [{robots}]\n", "mine"
    )
    with pytest.raises(ScenarioError, match=says):
        World(scenario)


def test_a_negative_seed_is_refused() -> None:
    scenario = Scenario(name="a", title="a", help="a", declares="ideal", duration_s=1)
    with pytest.raises(ScenarioError, match="seed"):
        World(scenario, -1)
