"""Disparity of single points, on pairs with known disparity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.parameters import StereoParameters
from observer.vision.sparse_stereo import RowSearch

from ..builders import Texture, as_image, pixel_grid

quick = settings(max_examples=30)
P = StereoParameters(max_disparity_px=96)
WIDTH, HEIGHT = 320, 128
WALL = Texture(5, (HEIGHT, WIDTH))
BOARD = Texture(6, (HEIGHT, WIDTH))
# FREE: visible to both cameras at any disparity.
POINTS = pixel_grid(WIDTH, HEIGHT, 11, 10)
FREE = POINTS[POINTS[:, 0] > 106]


def pair(
    disparity: float, noise: float = 1.5, gain: float = 1.0, offset: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    left, right = WALL.moved(), WALL.moved(-disparity)
    return (
        as_image(left, noise, seed=1),
        as_image(right, noise, seed=2, gain=gain, mean=110 + offset),
    )


@quick
@given(st.floats(0.0, 80.0))
def test_planted_disparities_are_found_to_about_a_pixel(planted: float) -> None:
    found = RowSearch.of(*pair(planted), P).matches(FREE).disparity
    known = np.isfinite(found)
    assert known.mean() > 0.9
    error = np.abs(found - planted)[known]
    assert np.mean(error < 1.5) > 0.99
    assert np.median(error) < 1.1


def test_each_point_gets_its_own_disparity() -> None:
    """A board at 40 px disparity, left columns 160 to 240, in front of a wall at 12 px."""
    u = np.arange(WIDTH)
    left = np.where((u >= 160) & (u < 240), BOARD.moved(), WALL.moved())
    right = np.where((u >= 120) & (u < 200), BOARD.moved(-40.0), WALL.moved(-12.0))
    found = RowSearch.of(as_image(left), as_image(right), P).matches(POINTS).disparity
    on_board = (POINTS[:, 0] > 172) & (POINTS[:, 0] < 228)
    beside = (POINTS[:, 0] > 252) | ((POINTS[:, 0] > 40) & (POINTS[:, 0] < 120))
    for which, planted in ((on_board, 40.0), (beside, 12.0)):
        known = np.isfinite(found[which])
        assert known.mean() > 0.9
        assert np.mean(np.abs(found[which][known] - planted) < 1.5) > 0.98
    # These wall columns of the left image are hidden by the board in the right one.
    hidden = (POINTS[:, 0] > 138) & (POINTS[:, 0] < 154)
    wrong = np.isfinite(found[hidden]) & (np.abs(found[hidden] - 12) > 2)
    assert wrong.mean() < 0.3


@pytest.mark.parametrize(("gain", "offset"), [(0.75, 0.0), (1.25, 0.0), (1.0, 25.0), (1.0, -40.0)])
def test_unequal_camera_brightness_is_tolerated(gain: float, offset: float) -> None:
    found = RowSearch.of(*pair(23.0, gain=gain, offset=offset), P).matches(FREE).disparity
    known = np.isfinite(found)
    assert known.mean() > 0.9
    assert np.mean(np.abs(found[known] - 23.0) < 1.5) > 0.99


@pytest.mark.parametrize("noise", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("period_px", [10, 16, 24])
def test_texture_repeating_along_the_row_has_no_disparity(period_px: int, noise: float) -> None:
    """The repetitions are indistinguishable."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))

    def tiles(shift: float) -> np.ndarray:
        wave = np.sin(2 * np.pi * (u + shift) / period_px) + np.sin(
            4 * np.pi * (u + shift) / period_px
        )
        return 30 * wave + 20 * np.sin(v / 3)

    images = as_image(tiles(0), noise, seed=1), as_image(tiles(20.0), noise, seed=2)
    found = RowSearch.of(*images, P).matches(FREE).disparity
    assert np.isfinite(found).mean() < 0.05


@pytest.mark.parametrize("period_px", [20, 22, 32])
def test_a_fence_before_a_faint_wall_recurs(period_px: int) -> None:
    """What shows between the slats makes a wrong match of them the best one by far."""
    u = np.arange(WIDTH)
    slats = Texture(7, (HEIGHT, 1)).moved() + 40

    def scene(fence_px: float, wall_px: float) -> np.ndarray:
        slat = (u + fence_px) % period_px < period_px / 2
        return np.where(slat, slats, 0.1 * WALL.moved(-wall_px))

    # The slats differ from the wall by one period, so that both match at the wall's disparity.
    wall_px, fence_px = 3.0, 3.0 + period_px
    images = as_image(scene(0, 0), 1.0, seed=1), as_image(scene(fence_px, wall_px), 1.0, seed=2)
    slats_px = FREE[FREE[:, 0] % period_px < period_px / 2]
    found = RowSearch.of(*images, P).matches(slats_px)
    wrong = np.abs(found.disparity - wall_px) < 2
    assert wrong.mean() > 0.2
    assert found.recurs[wrong].mean() > 0.85


def test_a_wall_does_not_recur() -> None:
    assert RowSearch.of(*pair(30.0), P).matches(FREE).recurs.mean() < 0.02


def test_a_disparity_is_contradicted_by_a_clearly_better_one() -> None:
    rows = RowSearch.of(*pair(30.0), P)
    assert not rows.contradicts(FREE, np.full(len(FREE), 30.0, np.float32)).any()
    assert not rows.contradicts(FREE, np.full(len(FREE), 31.0, np.float32)).any()
    assert rows.contradicts(FREE, np.full(len(FREE), 45.0, np.float32)).mean() > 0.95
    assert not rows.contradicts(FREE, np.full(len(FREE), np.nan, np.float32)).any()


def test_a_disparity_is_kept_while_another_one_matches_as_well() -> None:
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    left, right = (
        as_image(40 * np.sin(2 * np.pi * (u + shift) / 20) + 20 * np.sin(v / 3), 1.0, seed=seed)
        for shift, seed in ((0.0, 1), (24.0, 2))
    )
    rows = RowSearch.of(left, right, P)
    for repetition in (24.0, 44.0):
        held = np.full(len(FREE), repetition, np.float32)
        assert rows.contradicts(FREE, held).mean() < 0.05
    assert rows.contradicts(FREE, np.full(len(FREE), 34.0, np.float32)).mean() > 0.9


def horizontal_stripes() -> np.ndarray:
    v = np.arange(HEIGHT)[:, None]
    return np.broadcast_to(50 * np.sin(v / 3.0), (HEIGHT, WIDTH))


@pytest.mark.parametrize(
    "grey", [np.zeros((HEIGHT, WIDTH)), horizontal_stripes()], ids=["blank", "stripes"]
)
def test_no_texture_along_the_row_gives_no_disparity(grey: np.ndarray) -> None:
    """Every disparity fits equally well."""
    image = as_image(grey)
    assert np.isnan(RowSearch.of(image, image, P).matches(FREE).disparity).all()


def test_points_outside_the_right_image_are_mostly_unmatched() -> None:
    """At 60 px of disparity, points left of column 60 lie outside the right image."""
    u = np.arange(WIDTH)
    right = np.where(u < WIDTH - 60, WALL.moved(-60.0), BOARD.moved())
    found = RowSearch.of(as_image(WALL.moved()), as_image(right), P).matches(POINTS).disparity
    known = np.isfinite(found)
    assert (found[known] <= POINTS[known, 0]).all()
    # Some of them match something else by chance.
    assert known[POINTS[:, 0] < 50].mean() < 0.5
    assert known[POINTS[:, 0] > 72].mean() > 0.9


def test_disparities_beyond_the_maximum_are_mostly_unmatched() -> None:
    found = RowSearch.of(*pair(60.0), StereoParameters(max_disparity_px=48)).matches(FREE).disparity
    # Some of them match something else within the search range by chance.
    assert np.isfinite(found).mean() < 0.5
    assert (found[np.isfinite(found)] <= 48).all()
    wider = RowSearch.of(*pair(60.0), StereoParameters(max_disparity_px=64)).matches(FREE).disparity
    assert np.isfinite(wider).mean() > 0.9


def test_points_at_the_very_edge_and_no_points_are_accepted() -> None:
    corners = np.array(
        [[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]], np.float32
    )
    found = RowSearch.of(*pair(8.0), P).matches(corners).disparity
    assert found.shape == (4,)
    assert np.isnan(found[[0, 2]]).all() or (found[[0, 2]] <= 0.5).all()
    none = RowSearch.of(*pair(8.0), P).matches(np.zeros((0, 2), np.float32)).disparity
    assert none.shape == (0,)
    assert none.dtype == np.float32
