"""People of the simulated lab: their steps, their outline, and how a camera sees them."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Float64Array
from observer.simulation.imaging import LEFT, StereoImager
from observer.simulation.motion import Course, Leg, Parked, PlanarMotion
from observer.simulation.people.ellipsoids import Ellipsoids, silhouettes
from observer.simulation.people.figure import Figure
from observer.simulation.people.gait import Gait
from observer.simulation.people.outfit import PATTERNS, TONES, dressed
from observer.simulation.scenarios import load_scenario, scenario_from_text, scenario_names
from observer.simulation.specs.people import ClothesSpec, Pattern, Tone
from observer.simulation.truth import SimulatedTruth
from observer.simulation.visibility import visible_parts
from observer.simulation.world import World

from ..pixel_truth import left_hits

SCENES = [name for name in scenario_names() if name.startswith("people")]
# Left foot and right foot among the limbs of a figure.
FEET = [k for k, limb in enumerate(Figure.limbs) if limb.cloth == "shoes"]


def walking(speed: float) -> PlanarMotion:
    return Course(
        0, 0, 0, [Leg(distance=20, speed=speed)],
        after="stay", acceleration=2.0, angular_acceleration=1.0,
    )  # fmt: skip


def gait(motion: PlanarMotion, height: float = 1.75, gesture: str = "walk") -> Gait:
    return Gait(motion, height, Figure.leg_m(height), gesture, 1.0, 10.0)


def figure(motion: PlanarMotion, height: float = 1.75, gesture: str = "walk") -> Figure:
    return Figure(height, 1.0, gait(motion, height, gesture))


def turned(rng: np.random.Generator) -> Float64Array:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q)


@given(st.integers(0, 10_000))
@settings(max_examples=60)
def test_rays_hit_an_ellipsoid_on_its_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = np.array([*rng.uniform(-1, 1, 2), rng.uniform(1.0, 5.0)])
    axes, semi = turned(rng), rng.uniform(0.05, 0.6, 3)
    (outline,) = silhouettes(Ellipsoids(centre[None], axes[None], semi[None]))
    assert outline is not None
    x, y = (rng.uniform(-1.5, 1.5, 400) for _ in range(2))
    disc, inverse = outline.meet(x, y)
    hit = disc > 1e-9
    points = np.stack([x, y, np.ones_like(x)], axis=1)[hit] / inverse[hit, None]
    length = np.linalg.norm((points - centre) @ axes / semi, axis=1)
    assert length == pytest.approx(1.0, abs=1e-6)
    # No part of it lies outside the bounds of its outline.
    x0, y0, x1, y1 = outline.bounds
    assert ((x[hit] >= x0) & (x[hit] <= x1) & (y[hit] >= y0) & (y[hit] <= y1)).all()


def test_an_ellipsoid_behind_the_camera_is_not_seen() -> None:
    behind = Ellipsoids(np.array([[0.0, 0.0, -2.0]]), np.eye(3)[None], np.full((1, 3), 0.5))
    assert silhouettes(behind) == [None]


@pytest.mark.parametrize("speed", [0.4, 0.9, 1.4])
def test_one_foot_stays_on_the_floor_while_the_body_moves(speed: float) -> None:
    motion = walking(speed)
    it = figure(motion)
    slides, step = [], 0.02
    for time in np.arange(3.0, 5.0, step):
        low = [it.shape(t).centres[FEET] for t in (time, time + step)]
        standing = int(np.argmin(low[0][:, 2]))
        soles = low[0][standing, 2] - it.shape(time).semi[FEET[standing], 2]
        assert soles == pytest.approx(0.0, abs=0.02)
        moved = low[1][standing, 0] - low[0][standing, 0]
        slides.append(moved / step + speed)
    # In the body's frame a standing foot moves backward as fast as the body moves forward.
    assert abs(np.median(slides)) < 0.35 * speed


def test_strides_grow_with_speed_and_a_standing_person_is_still() -> None:
    standing = figure(Parked(1.0, 2.0, 0.5))
    assert np.array_equal(standing.shape(0.3).centres, standing.shape(7.1).centres)
    slow, quick = figure(walking(0.5)), figure(walking(1.4))
    reach = [np.ptp([f.shape(t).centres[FEET[0], 0] for t in np.arange(3, 6, 0.05)])
             for f in (slow, quick)]  # fmt: skip
    assert reach[0] < 0.8 * reach[1]


def test_a_person_walks_on_after_the_scenario_whatever_was_asked_before() -> None:
    # A robot that is driven keeps the source running for as long as it is driven.
    motion = Course(
        0, 0, 0, [Leg(distance=3, speed=1.2)],
        after="back", acceleration=2.0, angular_acceleration=1.0,
    )  # fmt: skip
    times = (80.0, 80.3, 95.0, 312.7)
    it = gait(motion)
    in_order = [it.joints(time) for time in times]
    assert abs(in_order[1][0].hip - in_order[0][0].hip) > 0.1
    other = gait(motion)
    assert [other.joints(time) for time in reversed(times)] == in_order[::-1]


def test_a_waving_person_moves_only_one_arm() -> None:
    it = figure(Parked(0, 0, 0), gesture="wave")
    places = np.array([it.shape(t).centres for t in np.arange(0, 2, 0.1)])
    moves = np.ptp(places, axis=0).max(axis=1)
    assert np.count_nonzero(moves > 0.05) == 2, "forearm and hand"
    assert moves[FEET].max() == 0


@given(st.integers(0, 500))
@settings(max_examples=30)
def test_given_clothes_are_worn_and_equal_seeds_draw_equal_others(seed: int) -> None:
    given_clothes = ClothesSpec(top="printed", top_tone="red")
    first, again = dressed(given_clothes, seed), dressed(given_clothes, seed)
    assert first == again
    assert first["top"].kind == "cloth_printed"
    assert first["trousers"].kind.removeprefix("cloth_") in PATTERNS


def test_scenarios_accept_every_pattern_and_tone() -> None:
    assert set(Pattern.__args__) == set(PATTERNS)  # type: ignore[attr-defined]
    assert set(Tone.__args__) == set(TONES)  # type: ignore[attr-defined]


@pytest.mark.parametrize("scene", SCENES)
def test_people_are_drawn_where_rays_hit_them(scene: str) -> None:
    """Images with and without people differ exactly where rays hit people."""
    scenario = load_scenario(scene)
    world = World(scenario, seed=1)
    empty = World(scenario.model_copy(update={"people": ()}), seed=1)
    time = 2.4
    images = [
        cv2.cvtColor(StereoImager(w).clean(LEFT, time), cv2.COLOR_BGR2GRAY).astype(int)
        for w in (world, empty)
    ]
    drawn = np.abs(images[0] - images[1]) > 4
    people = {body.id for body in world.bodies if body.person is not None}
    hit = np.isin(left_hits(world, time).body, list(people))
    assert hit.sum() > 500
    # A tone may match the background, and a shadow lies beside the feet.
    assert (drawn & hit).sum() > 0.85 * hit.sum()
    beside = cv2.dilate(hit.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    horizon = world.scenario.camera.height // 2
    above = np.arange(len(hit))[:, None] < horizon
    assert (drawn & beside & above).mean() < 0.01


def test_truth_gives_the_velocity_and_visible_share_of_a_person() -> None:
    text = """
title: One person
help: A person walks across.
declares: ideal
duration_s: 5
camera: {height_m: 0.9}
room: {x: [-2, 7], y: [-3, 3], height_m: 2.6}
people:
  - {name: Ada, x: 3.0, y: -1.4, heading_deg: 90, height_m: 1.7,
     motion: {kind: course, legs: [{kind: drive, distance_m: 3, speed: 1.1}], acceleration: 5}}
"""
    world = World(scenario_from_text(text, "one"))
    truth = SimulatedTruth(world)
    (person,) = (body for body in truth.bodies(1.5) if body.role == "obstacle")
    assert person.name == "Ada"
    assert person.kind == "person"
    assert person.speed == pytest.approx(1.1)
    assert person.size[2] == pytest.approx(1.7)
    assert person.visible is not None
    assert person.visible > 0.9
    (body,) = world.obstacles
    assert visible_parts(world, 0.0)[body.id].share < person.visible, "half out of view at first"


def test_different_seeds_draw_different_people() -> None:
    scenario = load_scenario(SCENES[0])
    people = [World(scenario, seed).scenario.people[0] for seed in (0, 1, 2)]
    assert len({person.height_m for person in people}) == 3
    assert all(math.isfinite(person.build) for person in people)


def test_a_waving_or_standing_person_has_no_speed() -> None:
    truth = SimulatedTruth(World(load_scenario("people_standing")))
    for time in (0.0, 1.3, 4.2):
        people = [body for body in truth.bodies(time) if body.kind == "person"]
        assert [person.speed for person in people] == [0.0, 0.0]


@pytest.mark.parametrize("name", SCENES)
def test_people_stay_inside_the_room_with_every_seed(name: str) -> None:
    for seed in range(1, 60):
        World(load_scenario(name), seed)


@pytest.mark.parametrize("name", ["people_near", "people_toward"])
def test_the_camera_is_static_in_scenes_with_a_standing_observer(name: str) -> None:
    assert World(load_scenario(name), 2).camera_is_static


def test_people_in_plain_clothes_wear_no_pattern() -> None:
    for seed in (0, 1, 2):
        for body in World(load_scenario("people_plain"), seed).obstacles:
            assert body.person is not None
            assert {body.person.outfit[c].kind for c in ("top", "trousers")} == {"cloth_plain"}
