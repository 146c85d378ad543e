"""Cells that look different from a moment ago, for worlds whose every change is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.rigid.dense.free_space import DepthFrame
from observer.methods.rigid.dense.grey_change import GreyChange, Light
from observer.types import Image

from ..solid_worlds import GRID, HERE, ROOM, Shape, Solid, cells_of, disparity_of

ALL = np.ones(GRID.shape, np.bool_)
LAG_S = 0.13
HAND = Solid((0.3, -0.3, 3.0), (0.25, 0.25, 0.1))
ELSEWHERE = Solid((0.7, -0.3, 3.0), (0.25, 0.25, 0.1))


def look(
    time: float, shapes: Sequence[Shape], pose: Pose = HERE, *, bright: Shape | None = None
) -> tuple[DepthFrame, Image]:
    """One frame in which all is grey except for one bright thing."""
    grey = np.full(GRID.shape, 90, np.uint8)
    if bright is not None:
        grey[cells_of(bright, shapes, pose)] = 180
    return DepthFrame(time, disparity_of(shapes, pose), pose.inverse()), grey


def changed(before: tuple[DepthFrame, Image], now: tuple[DepthFrame, Image]) -> np.ndarray:
    change = GreyChange(GRID)
    assert not change.changed(*before, ALL).any()
    return change.changed(*now, ALL)


def test_static_objects_do_not_change_while_the_camera_moves() -> None:
    shapes = [*ROOM, HAND]
    moved = Pose(np.eye(3), np.array([0.04, 0.0, 0.06]))
    out = changed(look(0.0, shapes, bright=HAND), look(LAG_S, shapes, moved, bright=HAND))
    assert np.count_nonzero(out) < 0.1 * np.count_nonzero(cells_of(HAND, shapes))


def test_a_moved_hand_changes_the_cells_at_its_new_position() -> None:
    there = [*ROOM, ELSEWHERE]
    out = changed(look(0.0, [*ROOM, HAND], bright=HAND), look(LAG_S, there, bright=ELSEWHERE))
    mine = cells_of(ELSEWHERE, there)
    assert out[mine].mean() > 0.5
    assert out[~mine].mean() < 0.01


def test_recently_hidden_cells_are_not_compared() -> None:
    out = changed(look(0.0, [*ROOM, HAND], bright=HAND), look(LAG_S, ROOM))
    assert not out.any()


def test_changing_exposure_is_not_a_change() -> None:
    shapes = [*ROOM, HAND]
    frame, grey = look(LAG_S, shapes, bright=HAND)
    assert not changed(look(0.0, shapes, bright=HAND), (frame, (grey * 1.3).astype(np.uint8))).any()


@pytest.mark.parametrize("ago", [0.02, 0.5])
def test_frames_too_recent_or_too_old_are_not_compared(ago: float) -> None:
    there = [*ROOM, ELSEWHERE]
    assert not changed(
        look(0.0, [*ROOM, HAND], bright=HAND), look(ago, there, bright=ELSEWHERE)
    ).any()


@pytest.mark.parametrize("gains", [(1.0, 1.6), (1.6, 1.0)])
def test_overexposed_cells_are_not_compared(gains: tuple[float, float]) -> None:
    """A bright hand (180) that does not move is overexposed in one of the two frames."""
    shapes = [*ROOM, HAND]
    frames = [look(time, shapes, bright=HAND) for time in (0.0, LAG_S)]
    lit = [
        (frame, np.clip(grey * gain, 0, 255).astype(np.uint8))
        for (frame, grey), gain in zip(frames, gains, strict=True)
    ]
    assert not changed(*lit).any()


@pytest.mark.parametrize("settling", [0.0, 0.02])
@pytest.mark.parametrize("shaded", [0.1, 0.4])
def test_light_flickers_when_much_of_the_static_scene_changes_brightness(
    shaded: float, settling: float
) -> None:
    """Shadows of leaves, in different places in each frame, also while the exposure settles."""
    rng = np.random.default_rng(1)
    change = GreyChange(GRID)
    for k in range(12):
        frame, grey = look(k * LAG_S, ROOM)
        leaves = rng.random((GRID.height // 8 + 1, GRID.width // 8 + 1)) < shaded
        dark = leaves.repeat(8, axis=0).repeat(8, axis=1)[: GRID.height, : GRID.width]
        lit = np.where(dark, 0.8, 1.0) * grey * (1 + settling * k)
        change.changed(frame, lit.astype(np.uint8), ALL)
    assert change.light.flickers is (shaded > 0.2)


def test_noise_and_texture_under_steady_light_do_not_flicker() -> None:
    rng = np.random.default_rng(2)
    change = GreyChange(GRID)
    for k in range(12):
        pose = Pose(np.eye(3), np.array([0.01 * k, 0.0, 0.01 * k]))
        frame, grey = look(k * LAG_S, [*ROOM, HAND], pose, bright=HAND)
        change.changed(frame, (grey + rng.normal(0, 1.5, GRID.shape)).astype(np.uint8), ALL)
    assert not change.light.flickers


def test_texture_finer_than_the_cells_does_not_flicker_as_the_camera_moves() -> None:
    """Between frames it falls on the cells differently: each is compared with all around it."""
    rng = np.random.default_rng(3)
    change = GreyChange(GRID)
    fine = rng.integers(40, 200, (2 * GRID.height + 40, 2 * GRID.width + 40)).astype(np.float64)
    for k in range(12):
        frame, _ = look(k * LAG_S, ROOM)
        part = fine[k % 2 :, k % 2 :][: 2 * GRID.height, : 2 * GRID.width]
        grey = part.reshape(GRID.height, 2, GRID.width, 2).mean(axis=(1, 3))
        change.changed(frame, grey.astype(np.uint8), ALL)
    assert not change.light.flickers


@pytest.mark.parametrize(("swing", "expected"), [(0.02, False), (0.08, False), (0.4, True)])
def test_the_exposure_swings_when_the_whole_image_changes_fast(
    swing: float, expected: bool
) -> None:
    """An exposure that settles, by a few per cent a frame, does not swing."""
    change = GreyChange(GRID)
    for k in range(12):
        frame, grey = look(k * LAG_S, ROOM)
        gain = 1 + swing * np.sin(1.6 * k)
        change.changed(frame, (gain * 0.6 * grey).astype(np.uint8), ALL)
    assert change.light == Light(flickers=False, swings=expected)


@pytest.mark.parametrize("width", [0.5, 1.5])
def test_a_person_walking_past_close_by_does_not_count_as_changing_light(width: float) -> None:
    """Dark trousers hide and uncover a large part of a bright wall."""
    change = GreyChange(GRID)
    for k in range(12):
        trousers = Solid((-1.2 + 0.2 * k, 0.0, 1.5), (width, 2.0, 0.2))
        shapes = [*ROOM, trousers]
        frame, grey = look(k * LAG_S, shapes)
        grey[cells_of(trousers, shapes)] = 25
        change.changed(frame, grey, ALL)
        assert change.light == Light()
