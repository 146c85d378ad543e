"""Depth at a pixel: against the simulated lab's exact rays, and from known disparities."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from app.contract.calibrating import PlaceDepth
from app.engine.depth_measuring import measure_depth
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, InputError
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.visibility import cast
from observer.simulation.world import World
from observer.types import StereoFrame

WIDTH, HEIGHT, FOCAL, BASELINE = 320, 200, 300.0, 0.1
CENTRE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
TEXT = calibration_text(StereoCalibration.rectified(WIDTH, HEIGHT, FOCAL, FOCAL, *CENTRE, BASELINE))


def textured(disparity: np.ndarray, seed: int = 0) -> StereoFrame:
    """A pair in which every left pixel has the given disparity; (H, W) pixels."""
    rng = np.random.default_rng(seed)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (HEIGHT, WIDTH + 200)), (0, 0), 1.2)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.float32)
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    right = np.ascontiguousarray(texture[:, :WIDTH])
    left = cv2.remap(
        texture, u - disparity.astype(np.float32), v, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT
    )
    pair = [np.clip(each, 0, 255).astype(np.uint8) for each in (left, right)]
    return StereoFrame(0, 0.0, pair[0], pair[1], received=0.0)


def at(frame: StereoFrame, u: float, v: float, text: str = TEXT) -> PlaceDepth:
    beats = []
    found = measure_depth(frame, text, u, v, lambda: beats.append(1))
    assert beats
    return found


def test_depth_in_the_lab_matches_its_exact_geometry() -> None:
    world = World(load_scenario("lab"))
    frame = SimulatedSource(world).read()
    assert frame is not None
    text = calibration_text(world.calibration)
    K = world.calibration.K1
    # Near and far floor, the P3-DX, both crates with what stands on them, the cabinet.
    places = [
        *((100, 235), (256, 240), (420, 225), (330, 190), (200, 170), (60, 180)),
        *((125, 130), (165, 132), (50, 105)),
    ]
    for u, v in places:
        ray = np.array([[(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]]])
        hit = cast(world, world.T_room_left(0.0).inverse(), ray, 0.0)
        depth = 1 / hit.inverse_depth[0]
        found = at(frame, u, v, text)
        assert found.depth_m == pytest.approx(depth, rel=0.03), (u, v)
        # The range is measured along the ray, as with a tape measure.
        along = float(np.hypot(1, np.linalg.norm(ray)))
        assert found.range_m == pytest.approx(depth * along, rel=0.03), (u, v)
        f_b = K[0, 0] * world.calibration.baseline
        assert found.disparity_px == pytest.approx(f_b / found.depth_m)


@pytest.mark.parametrize("disparity", [3.4, 20.0, 77.25, 100.0])
def test_known_disparity_gives_depth(disparity: float) -> None:
    found = at(textured(np.full((HEIGHT, WIDTH), disparity)), 250, 100)
    assert found.disparity_px == pytest.approx(disparity, abs=0.25)
    assert found.depth_m == pytest.approx(FOCAL * BASELINE / found.disparity_px)


@pytest.mark.parametrize(("u", "v"), [(319, 199), (319, 0), (200.4, 0.4), (318.6, 100.5)])
def test_depth_at_the_image_border(u: float, v: float) -> None:
    found = at(textured(np.full((HEIGHT, WIDTH), 20.0)), u, v)
    assert found.disparity_px == pytest.approx(20.0, abs=0.3)


def test_a_floor_below_a_low_camera_is_not_an_edge() -> None:
    # As for a camera 0.3 m above the floor: a third of a pixel from row to row.
    rows = np.maximum(np.arange(HEIGHT) - CENTRE[1], 0) * BASELINE / 0.3 + 2
    frame = textured(np.repeat(rows[:, None], WIDTH, axis=1))
    found = at(frame, 250, 170)
    assert found.disparity_px == pytest.approx(rows[170], abs=0.3)


def slab(first: int, end: int, near: float = 30.0, far: float = 10.0) -> StereoFrame:
    """A flat body before a wall: columns ``first`` to ``end`` of the left image."""
    things = textured(np.full((HEIGHT, WIDTH), near), 1), textured(np.full((HEIGHT, WIDTH), far), 2)
    columns = np.arange(WIDTH, dtype=float)
    left = np.where((columns >= first) & (columns < end), things[0].left, things[1].left)
    columns = columns + near
    right = np.where((columns >= first) & (columns < end), things[0].right, things[1].right)
    return StereoFrame(0, 0.0, left, right, received=0.0)


@pytest.mark.parametrize("end", [WIDTH, 240, 209, 205])
def test_depth_near_an_edge_is_refused_or_correct(end: int) -> None:
    frame = slab(200, end)
    refused = []
    for u in range(180, min(end + 20, WIDTH)):
        try:
            found = at(frame, u, 100).disparity_px
        except InputError:
            refused.append(u)
            continue
        # Blocks of 7 pixels are matched: the nearer body seems half a block wider.
        if abs(u - 199.5) > 4 and abs(u - end + 0.5) > 4:
            assert found == pytest.approx(30.0 if 200 <= u < end else 10.0, abs=0.5), u
    assert refused
    assert at(frame, 160, 100).disparity_px == pytest.approx(10.0, abs=0.2)
    if end == WIDTH:
        assert at(frame, 250, 100).disparity_px == pytest.approx(30.0, abs=0.2)


def test_a_spot_without_texture_is_refused() -> None:
    frame = textured(np.full((HEIGHT, WIDTH), 20.0))
    left, right = frame.left.copy(), frame.right.copy()
    left[40:160, 130:], right[40:160, 110:] = 128, 128
    plain = StereoFrame(0, 0.0, left, right, received=0.0)
    with pytest.raises(InputError, match="no depth at this spot"):
        at(plain, 230, 100)
    assert at(plain, 230, 15).disparity_px == pytest.approx(20.0, abs=0.2)


def test_a_spot_seen_by_one_camera_is_refused() -> None:
    # The matching point would lie beyond the right image's left border.
    rng = np.random.default_rng(3)
    frame = textured(np.full((HEIGHT, WIDTH), 20.0))
    left = frame.left.copy()
    left[:, :40] = rng.integers(0, 255, (HEIGHT, 40))
    with pytest.raises(InputError, match=r"no depth|at a depth edge"):
        at(StereoFrame(0, 0.0, left, frame.right, received=0.0), 8, 100)


@pytest.mark.parametrize(("u", "v"), [(-0.1, 5), (5, -1), (319.1, 5), (5, 199.5), (1e300, 1)])
def test_a_pixel_outside_the_image_is_refused(u: float, v: float) -> None:
    with pytest.raises(InputError, match="outside the image of 320 x 200"):
        at(textured(np.full((HEIGHT, WIDTH), 20.0)), u, v)


def test_a_calibration_of_another_size_is_refused() -> None:
    other = calibration_text(StereoCalibration.rectified(640, 480, 500, 500, 319.5, 239.5, 0.1))
    with pytest.raises(CalibrationError, match="640x480"):
        measure_depth(textured(np.full((HEIGHT, WIDTH), 20.0)), other, 100, 100, lambda: None)
