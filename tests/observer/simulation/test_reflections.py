"""What a glossy floor reflects, checked against mirrored geometry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.simulation.batches import View
from observer.simulation.imaging import LEFT, RIGHT, StereoImager
from observer.simulation.reflections import mirrored, reflectance
from observer.simulation.rendering import Renderer
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.visibility import cast
from observer.simulation.world import World

from .pixel_truth import left_hits, left_rays

BOARD = """
title: A board
help: A checkerboard on the front wall above a mirroring floor.
declares: ideal
duration_s: 10
room: {x: [-2, 4], y: [-2.5, 2.5], height_m: 2.6, floor: tiles, walls: bare, gloss: 1}
objects:
  - {kind: poster, wall: front, along_m: 0.06, height_m: 0.5, size: [2.0, 1.0],
     design: checkerboard}
texture: {share_without: 1}
"""
ALIVE = """
robots:
  - {x: 2.4, y: 0.7, motion: {kind: sway, left: {amplitude: 0.2, period_s: 4}}}
people:
  - {x: 3.0, y: -0.5, heading_deg: 90}
camera: {height_m: 0.9, tilt_deg: 12}
"""


def world(extra: str = "", gloss: float = 1.0) -> World:
    scene = scenario_from_text(BOARD + extra, "glossy")
    room = scene.room.model_copy(update={"gloss": gloss})
    return World(scene.model_copy(update={"room": room}))


def clean(scene: World, side: int = LEFT, time: float = 0.0) -> np.ndarray:
    return StereoImager(scene).clean(side, time)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
@pytest.mark.parametrize(
    "extra",
    ["", "shake: {roll: {amplitude: 6, phase_deg: 90}}", "observer: {heading_deg: 9}"],
    ids=["straight", "rolled", "turned"],
)
def test_reflected_corners_lie_where_the_mirrored_world_puts_them(extra: str, side: int) -> None:
    scene = world(extra)
    y, z = np.meshgrid(0.06 + 1.0 - 0.1 * np.arange(1, 20), 0.1 * np.arange(1, 10))
    below = np.stack([np.full(y.size, 4 - 0.004), y.ravel(), -z.ravel()], axis=-1)
    T_room_camera = scene.T_room_left(0.0) if side == LEFT else scene.T_room_right(0.0)
    T, c = T_room_camera.inverse(), scene.true_calibration
    expected = cv2.projectPoints(
        below, cv2.Rodrigues(T.rotation)[0], T.translation, c.K1, c.D1
    )[0].reshape(-1, 2)  # fmt: skip
    inside = (expected > 12).all(axis=1) & (expected < np.array([500, 244])).all(axis=1)
    assert inside.sum() > 40
    # Subtract the floor's own appearance, and scale the reflection to the board's brightness.
    view = View(512, 256, c.K1[0, 0], c.K1[1, 1], c.K1[0, 2], c.K1[1, 2], (0, 256))
    share = reflectance(view, (0, 0, 512, 256), T_room_camera.rotation, 1.0)[..., None]
    floor = (1 - share) * clean(world(extra, gloss=0.0), side)
    gray = ((clean(scene, side) - floor) / share).mean(axis=2)
    gray = cv2.GaussianBlur(np.clip(gray, 0, 255).astype(np.uint8), (0, 0), 1.2)
    start = expected[inside].astype(np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-4)
    found = cv2.cornerSubPix(gray, start.copy(), (4, 4), (-1, -1), criteria).reshape(-1, 2)
    error = np.linalg.norm(found - expected[inside], axis=1)
    assert np.median(error) < 0.05
    assert error.max() < 0.3
    assert np.abs((found - expected[inside]).mean(axis=0)).max() < 0.03


def test_only_the_floor_reflects_and_it_reflects_moving_people() -> None:
    t = 1.0
    scene, empty = world(ALIVE), world(ALIVE.split("people")[1].split("\n", 2)[2])
    matt = clean(world(ALIVE, gloss=0.0), time=t).astype(int)
    glossy = clean(scene, time=t).astype(int)
    hits = left_hits(scene, t)
    rays = left_rays(scene)
    points = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    points = scene.T_room_left(t).apply(points / hits.inverse_depth[..., None])
    floor = (points[..., 2] < 1e-6).astype(np.uint8)
    wide, narrow = (f(floor, np.ones((3, 3))) > 0 for f in (cv2.dilate, cv2.erode))
    # Except for pixels that a limb covers in part.
    assert np.abs(glossy - matt)[~wide].max() <= 5
    assert (glossy != matt)[~wide].mean() < 0.001
    assert (np.abs(glossy - matt)[narrow].max(axis=1) > 2).mean() > 0.5
    # Ray casting from the mirrored camera gives the body reflected at each pixel.
    view = View(512, 256, 1.0, 1.0, 0.0, 127.5, (0, 256))
    _, T_room_mirror = mirrored(view, scene.T_room_left(t), (0, 256))
    seen = cast(scene, T_room_mirror.inverse(), rays * [1, -1], t).body
    alone = clean(empty, time=t).astype(int)
    changed = np.abs(glossy - alone).max(axis=2) > 3
    for body in scene.obstacles:
        mirror = narrow & (cv2.erode((seen == body.id).astype(np.uint8), np.ones((3, 3))) > 0)
        assert mirror.sum() > 150, body.name
        assert changed[mirror].mean() > 0.8, body.name


def test_reflectance_is_highest_at_grazing_angles_and_scales_with_gloss() -> None:
    view = View(101, 101, 100.0, 100.0, 50.0, 50.0, (0, 101))
    # R_room_camera of cameras that look straight down and along the room's x.
    down = np.diag([1.0, -1.0, -1.0])
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    straight = reflectance(view, (0, 0, 101, 101), down, 1.0)
    assert straight[50, 50] == pytest.approx(0.04, abs=1e-6)
    assert straight[0, 0] > straight[25, 25] > 0.04
    level = reflectance(view, (0, 51, 101, 101), ahead, 1.0)
    assert level[0, 50] > 0.9
    assert (np.diff(level[:, 50]) < 0).all()
    dull = reflectance(view, (0, 51, 101, 101), ahead, 0.25)
    assert dull == pytest.approx(0.25 * level, abs=1e-6)


def test_strips_reflect_like_the_whole_image() -> None:
    scene = World(load_scenario("glossy_crossing"))
    f = scene.true_calibration.K1[0, 0]
    whole, strips = (np.empty((256, 512, 3), np.uint8) for _ in range(2))
    renderer = Renderer(scene)
    for image, step in ((whole, 256), (strips, 16)):
        for first in range(0, 256, step):
            view = View(512, 256, f, f, 255.5, 127.5, (first, first + step))
            renderer.draw(view, scene.T_room_left(2.0), 2.0, image)
    # As on a matt floor, a few pixels round differently.
    assert np.abs(whole.astype(int) - strips).max() <= 1
    assert (whole != strips).mean() < 0.001


def test_a_matt_floor_is_drawn_without_reflecting(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a matt floor was reflected")

    monkeypatch.setattr(Renderer, "_reflect", refuse)
    assert clean(World(load_scenario("lateral"))).shape == (256, 512, 3)
