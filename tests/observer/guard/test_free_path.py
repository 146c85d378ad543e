"""Free floor in images of the simulated lab, compared with where things really are."""

from __future__ import annotations

import math
import os
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from observer.camera import StereoCamera, as_gray
from observer.geometry import Float64Array
from observer.guard.free_path import FreePath
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan
from observer.mount import CameraMount
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.vision.rectification import Rectification

P = GuardParameters()
LOW_BOX = """
based_on: drive
robots: []
objects: [{kind: cardboard, x: 2.6, y: 0, size: [0.4, 1.2, 0.08]}]
"""
# GUARD_SEEDS asks for a wide sweep.
SEEDS = int(os.environ.get("GUARD_SEEDS", "0"))


class Scene:
    """One world as seen by its camera."""

    def __init__(self, name: str, seed: int) -> None:
        self.world = World(load_scenario(name), seed)
        self._imager = StereoImager(self.world)
        self._rectification = Rectification(self.world.calibration)
        self.camera: StereoCamera = self._rectification.camera
        c = self.world.scenario.camera
        tilt = math.radians(c.tilt_deg)
        self.mount = CameraMount(c.height_m, tilt, c.forward_m, c.baseline_m / 2)
        self.finder = FreePath(self.camera, self.mount, P)

    @lru_cache(maxsize=4)  # noqa: B019
    def pair(self, time: float) -> list[np.ndarray]:
        index = round(time * self.world.scenario.frame_rate)
        images = self._rectification.apply(*self._imager.pair(index, time))
        return [as_gray(image) for image in images]

    def surfaces(self, time: float, bearings: Float64Array) -> Float64Array:
        """(N,) true distance from the base to what the robot would run into."""
        state = self.world.observer.motion.state(time)
        origin = np.array([state.x, state.y])
        angle = state.heading + bearings
        ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        room = np.array([self.world.scenario.room.x, self.world.scenario.room.y])
        nearest = _leaves(origin, ray, room[:, 0], room[:, 1])
        for body in self.world.bodies:
            if body.bottom >= P.robot_height_m:
                continue
            at = body.motion.state(time)
            c, s = math.cos(at.heading), math.sin(at.heading)
            turn = np.array([[c, s], [-s, c]])
            half = np.array(body.size[:2]) / 2
            hit = _enters(turn @ (origin - (at.x, at.y)), ray @ turn.T, -half, half)
            nearest = np.minimum(nearest, hit)
        return nearest


@pytest.fixture(scope="module")
def drive() -> Scene:
    """Shared by the module, because making it takes longer than using it."""
    return Scene("drive", 0)


def _slabs(
    origin: Float64Array, ray: Float64Array, low: Float64Array, high: Float64Array
) -> tuple[Float64Array, Float64Array]:
    with np.errstate(divide="ignore"):
        a, b = (low - origin) / ray, (high - origin) / ray
    return np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)


def _enters(
    origin: Float64Array, ray: Float64Array, low: Float64Array, high: Float64Array
) -> Float64Array:
    begins, ends = _slabs(origin, ray, low, high)
    return np.where((begins <= ends) & (begins > 0), begins, np.inf)


def _leaves(
    origin: Float64Array, ray: Float64Array, low: Float64Array, high: Float64Array
) -> Float64Array:
    return _slabs(origin, ray, low, high)[1]


def _arrays(scan: FreeScan) -> tuple[Float64Array, ...]:
    blocked = np.array([np.inf if one is None else one for one in scan.blocked_m])
    return (
        np.array(scan.bearings), np.array(scan.known_from_m), np.array(scan.known_to_m), blocked,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["drive", "lab", "toward", "low_texture_flicker"])
def test_ground_reported_free_is_free_and_most_directions_are_covered(name: str) -> None:
    beyond: list[float] = []
    known, short, count = 0, 0, 0
    for seed in range(SEEDS or 1):
        scene = Scene(name, seed)
        for time in np.linspace(0.0, 0.9 * scene.world.scenario.duration_s, 4 if SEEDS else 2):
            scan = scene.finder.scan(*scene.pair(float(time)))
            bearings, begins, ends, blocked = _arrays(scan)
            true = scene.surfaces(float(time), bearings)
            free = ends > begins
            beyond += list((ends - true)[free])
            known, count = known + int(free.sum()), count + len(free)
            short += int(((blocked < 3.0) & (blocked < true - 0.3)).sum())
    print(  # noqa: T201
        f"{name}: free {100 * known / count:.0f} % of directions, falsely by more than 5 cm "
        f"{100 * np.mean(np.array(beyond) > 0.05):.2f} %, falsely blocked within 3 m "
        f"{100 * short / count:.1f} %"
    )
    assert np.mean(np.array(beyond) > 0.05) < 0.005
    assert max(beyond) < 0.3
    assert known > 0.5 * count
    assert short < 0.15 * count


def test_nothing_is_known_below_the_field_of_view(drive: Scene) -> None:
    scene = drive
    _, begins, ends, _ = _arrays(scene.finder.scan(*scene.pair(1.0)))
    down = scene.mount.tilt_rad + math.atan(scene.camera.height / 2 / scene.camera.fy)
    edge = scene.mount.height_m / math.tan(down) * (1 - P.step_m / scene.mount.height_m)
    free = ends > begins
    assert free.mean() > 0.8
    assert begins[free].min() > edge


def test_a_robot_in_front_is_a_surface() -> None:
    scene = Scene("toward", 0)
    for time in (4.0, 8.0):
        bearings, _, _, blocked = _arrays(scene.finder.scan(*scene.pair(time)))
        body = scene.world.obstacles[0].motion.state(time)
        own = scene.world.observer.motion.state(time)
        dx, dy = body.x - own.x, body.y - own.y
        at = math.remainder(math.atan2(dy, dx) - own.heading, 2 * math.pi)
        toward = np.abs(bearings - at) < math.radians(1.6)
        assert blocked[toward].min() == pytest.approx(math.hypot(dx, dy) - 0.2, abs=0.35)


@pytest.mark.parametrize("covered", ["both", "left", "right", "grey", "shifted"])
def test_uninformative_images_leave_everything_unknown(drive: Scene, covered: str) -> None:
    left, right = drive.pair(1.0)
    rng = np.random.default_rng(0)
    dark = [rng.integers(0, 12, left.shape).astype(np.uint8) for _ in range(2)]
    if covered == "both":
        left, right = dark
    elif covered == "left":
        left = dark[0]
    elif covered == "right":
        right = dark[1]
    elif covered == "grey":
        left = right = np.full_like(left, 128)
    else:
        # The rows of the two images do not match.
        right = np.ascontiguousarray(np.roll(right, 40, axis=0))
    _, begins, ends, _ = _arrays(drive.finder.scan(left, right))
    assert np.mean(ends > begins) <= (0.15 if covered == "shifted" else 0.0)


def test_an_object_on_the_floor_ends_the_free_ground() -> None:
    """A textured plane and a textured box, drawn from their disparities alone."""
    camera = StereoCamera(512, 256, 443.4, 443.4, 255.5, 127.5, 0.12)
    mount = CameraMount(0.4, math.radians(5), 0.0, 0.0)
    finder = FreePath(camera, mount, P)
    free = _arrays(finder.scan(*_drawn(camera, mount, None)))
    boxed = _arrays(finder.scan(*_drawn(camera, mount, 2.0)))
    ahead = np.abs(free[0]) < math.radians(5)
    assert (free[2][ahead] > 3.5).all()
    assert (free[3][ahead] > 4.0).all()
    assert (boxed[2][ahead] < 2.05).all()
    assert np.abs(boxed[3][ahead] - 2.0).max() < 0.2


def test_a_surface_is_measured_down_to_the_distance_that_the_scan_states() -> None:
    camera = StereoCamera(512, 256, 443.4, 443.4, 255.5, 127.5, 0.12)
    mount = CameraMount(0.4, math.radians(5), 0.0, 0.0)
    finder = FreePath(camera, mount, P)
    stated = finder.scan(*_drawn(camera, mount, None)).blind_m
    assert 0.3 < min(stated) <= max(stated) < 0.5
    bearings, _, _, blocked = _arrays(finder.scan(*_drawn(camera, mount, max(stated) + 0.03)))
    ahead = np.abs(bearings) < math.radians(5)
    assert np.abs(blocked[ahead] - max(stated)).max() < 0.08


def test_more_caution_does_not_hide_a_low_box(tmp_path: Path) -> None:
    path = tmp_path / "low_box.yaml"
    path.write_text(LOW_BOX)
    scene = Scene(str(path), 0)
    free_shares, blocked_shares = [], []
    for sigmas in (0.0, 1.0, 2.0, 3.5, 5.0):
        p = P.model_copy(update={"sigmas": sigmas})
        finder = FreePath(scene.camera, scene.mount, p)
        bearings, begins, ends, blocked = _arrays(finder.scan(*scene.pair(0.0)))
        at_box = np.abs(bearings) < math.radians(10)
        true = scene.surfaces(0.0, bearings)
        free_shares.append(np.mean(((ends > begins) & (ends > true + 0.05))[at_box]))
        blocked_shares.append(np.mean((blocked < true + 0.3)[at_box]))
    assert blocked_shares[0] > 0.8
    assert blocked_shares == sorted(blocked_shares)
    assert free_shares == sorted(free_shares, reverse=True)


def _drawn(camera: StereoCamera, mount: CameraMount, box_m: float | None) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    texture = rng.integers(0, 256, (camera.height, 3 * camera.width)).astype(np.float32)
    texture += np.roll(texture, 1, axis=1)
    texture /= 2
    v = np.arange(camera.height)
    down = mount.down[1] * (v - camera.cy) / camera.fy + mount.down[2]
    disparity = np.maximum(camera.fx * camera.baseline * down / mount.height_m, 0.0)
    rows = np.repeat(disparity[:, None], camera.width, axis=1)
    if box_m is not None:
        standing = camera.fx * camera.baseline / box_m
        part = rows[60:, 200:312]
        # From the floor up to 0.3 m.
        part[(part < standing) & (np.arange(60, camera.height)[:, None] > 115)] = standing
    u = np.arange(camera.width)
    right = texture[:, camera.width : 2 * camera.width]
    left = np.empty_like(right)
    for row in range(camera.height):
        line = np.arange(3 * camera.width) - camera.width
        left[row] = np.interp(u - rows[row], line, texture[row])
    return [left.astype(np.uint8), right.astype(np.uint8)]
