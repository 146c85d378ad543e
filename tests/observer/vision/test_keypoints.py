"""Where points are searched: spread over the image, denser where it matters, no duplicates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.parameters import KltTrackingParameters
from observer.vision.keypoints import (
    attention,
    density_weights,
    first_in_empty,
    grid_cells,
    has_corner,
    one_per_cell,
    strongest_corners,
)

from ..builders import Texture, as_image

quick = settings(max_examples=40)
SIDE = 16
P = KltTrackingParameters(spacing_px=SIDE)
WIDTH, HEIGHT = 256, 160
ROWS, COLUMNS = HEIGHT // SIDE, WIDTH // SIDE
NOWHERE = np.zeros((ROWS, COLUMNS), np.bool_)
EVERYWHERE = ~NOWHERE
NONE_TAKEN = np.zeros(0, np.intp)
IMAGE = as_image(Texture(3).moved(), noise=1.0)
# Pixels: nearer to the edge, Lucas-Kanade's window would leave the image.
MARGIN = P.window_px // 2
NO_BOXES, NO_POINTS = np.zeros((0, 4)), np.zeros((0, 2), np.float32)

sides = st.integers(6, 64)
seeds = st.integers(0, 2**32 - 1)


def cells(px: np.ndarray, side: float = SIDE) -> np.ndarray:
    """(N, 2) row and column of the square each point is in."""
    return np.floor(px[:, ::-1] / side).astype(int)


def scattered(seed: int, count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform((0, 0), (WIDTH - 0.01, HEIGHT - 0.01), (count, 2)).astype(np.float32)


# --- attention -----------------------------------------------------------------------------


def test_every_square_touched_by_an_obstacle_box_is_marked() -> None:
    marked = attention((WIDTH, HEIGHT), np.array([[40.0, 50.0, 70.0, 63.0]]), NO_POINTS, P)
    expected = NOWHERE.copy()
    expected[3:4, 2:5] = True
    np.testing.assert_array_equal(marked, expected)


@pytest.mark.parametrize(
    "box",
    [[-90, 10, -20, 60], [300, 10, 400, 60], [10, -80, 60, -40], [10, 170, 60, 300]],
    ids=["left", "right", "above", "below"],
)
def test_box_outside_the_image_marks_nothing(box: list[float]) -> None:
    assert not attention((WIDTH, HEIGHT), np.array([box], np.float64), NO_POINTS, P).any()


def test_box_partly_outside_marks_only_the_inside() -> None:
    marked = attention((WIDTH, HEIGHT), np.array([[-50.0, -20.0, 20.0, 500.0]]), NO_POINTS, P)
    expected = NOWHERE.copy()
    expected[:, :2] = True
    np.testing.assert_array_equal(marked, expected)


def test_moving_point_marks_its_square_and_its_neighbours() -> None:
    px = np.array([[100, 70], [0, 0], [WIDTH - 1, HEIGHT - 1]], np.float32)
    marked = attention((WIDTH, HEIGHT), NO_BOXES, px, P)
    expected = NOWHERE.copy()
    expected[3:6, 5:8] = True
    expected[:2, :2] = True
    expected[-2:, -2:] = True
    np.testing.assert_array_equal(marked, expected)
    boxes = np.array([[160.0, 112.0, 170.0, 114.0]])
    expected[7, 10] = True
    np.testing.assert_array_equal(attention((WIDTH, HEIGHT), boxes, px, P), expected)


@quick
@given(sides, st.integers(20, 700), st.integers(20, 400))
def test_squares_cover_the_whole_image(side: int, width: int, height: int) -> None:
    p = KltTrackingParameters(spacing_px=side)
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]])
    marked = attention((width, height), NO_BOXES, corners.astype(np.float32), p)
    assert marked.shape == (-(-height // side), -(-width // side))
    number = grid_cells(corners.astype(np.float32), marked, p)
    assert (number >= 0).all()


# --- squares -------------------------------------------------------------------------------


@quick
@given(seeds, st.sampled_from([8, 12, 18, 25, 32]))
def test_points_share_a_number_if_and_only_if_they_share_a_square(seed: int, side: int) -> None:
    rng = np.random.default_rng(seed)
    p = KltTrackingParameters(spacing_px=side)
    marked = rng.random((-(-HEIGHT // side), -(-WIDTH // side))) < 0.3
    px = np.floor(scattered(seed, 120) * 8) / 8
    number = grid_cells(px.astype(np.float32), marked, p)
    is_marked = marked[tuple(cells(px, side).T)]
    same_whole = (cells(px, side)[:, None] == cells(px, side)[None]).all(axis=2)
    same_quarter = (cells(px, side / 2)[:, None] == cells(px, side / 2)[None]).all(axis=2)
    expected = np.where(is_marked[:, None], same_quarter, same_whole)
    np.testing.assert_array_equal(number[:, None] == number[None], expected)


@quick
@given(seeds, st.integers(1, 300))
def test_weights_of_points_in_one_square_sum_to_one(seed: int, count: int) -> None:
    px = scattered(seed, count)
    weight = density_weights(px, P)
    assert ((weight > 0) & (weight <= 1)).all()
    assert weight.sum() == pytest.approx(len(np.unique(cells(px), axis=0)))
    for cell in np.unique(cells(px), axis=0):
        inside = (cells(px) == cell).all(axis=1)
        np.testing.assert_allclose(weight[inside], 1 / inside.sum())


def test_no_points_give_no_weights_or_cells() -> None:
    assert density_weights(NO_POINTS, P).shape == (0,)
    assert grid_cells(NO_POINTS, NOWHERE, P).shape == (0,)
    assert one_per_cell(NONE_TAKEN, np.zeros(0, np.int64)).shape == (0,)


# --- thinning ------------------------------------------------------------------------------


@quick
@given(seeds, st.integers(1, 100))
def test_longest_followed_point_of_each_square_is_retained(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    square = rng.integers(0, 20, count).astype(np.intp)
    sightings = rng.integers(1, 6, count)
    kept = one_per_cell(square, sightings)
    assert (np.diff(kept) > 0).all()
    assert sorted(square[kept]) == sorted(set(square.tolist()))
    for index in kept:
        rivals = np.flatnonzero(square == square[index])
        best = sightings[rivals].max()
        # Ties go to the first, so that the result is deterministic.
        assert index == rivals[sightings[rivals] == best][0]


def test_thinning_twice_changes_nothing() -> None:
    px = scattered(0)
    marked = np.random.default_rng(0).random(NOWHERE.shape) < 0.3
    square = grid_cells(px, marked, P)
    kept = one_per_cell(square, np.ones(len(px), np.int64))
    again = one_per_cell(square[kept], np.ones(len(kept), np.int64))
    np.testing.assert_array_equal(again, np.arange(len(kept)))


# --- new points ----------------------------------------------------------------------------


def test_textured_images_get_one_point_in_each_square() -> None:
    px = strongest_corners(IMAGE, NONE_TAKEN, NOWHERE, P)
    assert px.dtype == np.float32
    number = grid_cells(px, NOWHERE, P)
    assert len(np.unique(number)) == len(number)
    assert len(px) > 0.97 * ROWS * COLUMNS
    assert (px >= MARGIN).all()
    assert (px <= (WIDTH - 1 - MARGIN, HEIGHT - 1 - MARGIN)).all()


def test_points_are_spread_despite_one_bright_image_corner() -> None:
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    bright = np.where((u < 64) & (v < 48), 1.5, 0.3)
    image = as_image(bright * Texture(4).moved())
    px = strongest_corners(image, NONE_TAKEN, NOWHERE, P)
    for far in (px[:, 0] >= WIDTH / 2, px[:, 1] >= HEIGHT / 2):
        assert far.sum() == pytest.approx(len(px) / 2, rel=0.1)


def test_attention_makes_points_four_times_as_dense() -> None:
    marked = NOWHERE.copy()
    marked[2:6, 4:10] = True
    px = strongest_corners(IMAGE, NONE_TAKEN, marked, P)
    inside = marked[tuple(cells(px).T)]
    assert inside.sum() > 0.9 * 4 * marked.sum()
    assert (~inside).sum() > 0.97 * (~marked).sum()
    number = grid_cells(px, marked, P)
    assert len(np.unique(number)) == len(number)


@pytest.mark.parametrize("marked", [NOWHERE, EVERYWHERE], ids=["whole", "divided"])
def test_squares_with_a_followed_point_get_no_other(marked: np.ndarray) -> None:
    px = strongest_corners(IMAGE, NONE_TAKEN, marked, P)
    number = grid_cells(px, marked, P)
    assert len(strongest_corners(IMAGE, number, marked, P)) == 0
    missing = number[::3]
    refilled = strongest_corners(IMAGE, np.setdiff1d(number, missing), marked, P)
    np.testing.assert_array_equal(np.sort(grid_cells(refilled, marked, P)), np.sort(missing))
    np.testing.assert_array_equal(refilled, px[::3])


def test_turns_cover_every_square_and_marked_ones_always() -> None:
    marked = NOWHERE.copy()
    marked[2:4, 4:8] = True
    whole = strongest_corners(IMAGE, NONE_TAKEN, marked, P)
    seen = [strongest_corners(IMAGE, NONE_TAKEN, marked, P, turn) for turn in range(7, 11)]
    for px in seen:
        assert len(px) < 0.75 * len(whole)
        inside = marked[tuple(cells(px).T)]
        assert inside.sum() == marked[tuple(cells(whole).T)].sum()
    assert {tuple(p) for p in np.concatenate(seen)} == {tuple(p) for p in whole}


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_image_without_texture_gives_no_points(grey: int) -> None:
    image = np.full((HEIGHT, WIDTH), grey, np.uint8)
    assert len(strongest_corners(image, NONE_TAKEN, EVERYWHERE, P)) == 0


def test_straight_edges_give_no_points() -> None:
    image = np.full((HEIGHT, WIDTH), 60, np.uint8)
    image[:, 120:] = 200
    assert len(strongest_corners(image, NONE_TAKEN, NOWHERE, P)) == 0


def test_stronger_corner_of_a_square_is_found_at_its_position() -> None:
    image = np.full((HEIGHT, WIDTH), 90, np.uint8)
    # Both lie in the square that starts at (96, 64); the second is fainter.
    image[66:72, 98:104] = 220
    image[73:78, 105:110] = 120
    px = strongest_corners(image, NONE_TAKEN, NOWHERE, P)
    inside = px[(cells(px) == (4, 6)).all(axis=1)]
    assert len(inside) == 1
    corners = np.array([[98, 66], [103, 66], [98, 71], [103, 71]])
    assert np.abs(corners - inside).max(axis=1).min() <= 2


@quick
@given(seeds, sides)
def test_equal_images_give_equal_points(seed: int, side: int) -> None:
    p = KltTrackingParameters(spacing_px=side)
    rng = np.random.default_rng(seed)
    marked = rng.random((-(-HEIGHT // side), -(-WIDTH // side))) < 0.3
    taken = np.unique(grid_cells(scattered(seed, 40), marked, p))
    first = strongest_corners(IMAGE, taken, marked, p)
    np.testing.assert_array_equal(first, strongest_corners(IMAGE.copy(), taken.copy(), marked, p))
    assert not np.isin(grid_cells(first, marked, p), taken).any()


# --- points from a detector ----------------------------------------------------------------


def test_first_point_in_every_empty_square_is_taken() -> None:
    px = scattered(5, 4000)
    inside = ((px >= MARGIN + 1) & (px < np.array([WIDTH, HEIGHT]) - MARGIN - 1)).all(axis=1)
    marked = attention((WIDTH, HEIGHT), np.array([[40.0, 50.0, 70.0, 63.0]]), NO_POINTS, P)
    square = grid_cells(px, marked, P)
    taken = np.unique(square[:50])
    chosen = first_in_empty(px, (WIDTH, HEIGHT), taken, marked, P)
    expected: dict[int, int] = {}
    for index in np.flatnonzero(inside).tolist():
        if square[index] not in taken:
            expected.setdefault(int(square[index]), index)
    assert len(chosen) > 50
    assert sorted(chosen) == sorted(expected.values())


def test_half_of_the_unmarked_squares_have_their_turn() -> None:
    px = scattered(6, 4000)
    marked = NOWHERE.copy()
    marked[2, 3] = True
    at = [
        {
            *grid_cells(
                px[first_in_empty(px, (WIDTH, HEIGHT), NONE_TAKEN, marked, P, turn)], marked, P
            )
        }
        for turn in (7, 8, None)
    ]
    assert at[0] | at[1] == at[2]
    of_the_marked = {*grid_cells(px[grid_cells(px, marked, P) >= ROWS * COLUMNS], marked, P)}
    assert len(of_the_marked) == 4
    assert at[0] & at[1] == of_the_marked


def test_first_in_empty_accepts_no_points() -> None:
    assert len(first_in_empty(NO_POINTS, (WIDTH, HEIGHT), NONE_TAKEN, NOWHERE, P, 3)) == 0


# --- corners and straight edges ------------------------------------------------------------


def drawn(angle: float, noise: float = 0.0, corner: bool = False, seed: int = 0) -> np.ndarray:
    """(96, 96) an edge through the middle at an angle, rad; a perpendicular one makes a corner."""
    v, u = np.indices((96, 96)) - 47.5
    along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
    # Blurred as by a lens, over a pixel or two.
    bright = 1 / (1 + np.exp(-across))
    if corner:
        bright = bright / (1 + np.exp(-along))
    return as_image(100 * bright, noise, seed, mean=60.0)


MIDDLE = np.array([[47.5, 47.5]], np.float32)


@quick
@given(angle=st.floats(0, 2 * np.pi), noise=st.floats(0, 2), seed=st.integers(0, 99))
def test_straight_edge_at_any_angle_is_not_a_corner(angle: float, noise: float, seed: int) -> None:
    assert not has_corner(drawn(angle, noise, seed=seed), MIDDLE).any()


@quick
@given(angle=st.floats(0, 2 * np.pi), noise=st.floats(0, 2), seed=st.integers(0, 99))
def test_meeting_of_two_edges_is_a_corner(angle: float, noise: float, seed: int) -> None:
    assert has_corner(drawn(angle, noise, corner=True, seed=seed), MIDDLE).all()


def test_texture_has_corners_almost_everywhere() -> None:
    v, u = np.meshgrid(np.arange(HEIGHT), np.arange(WIDTH))
    px = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)
    assert has_corner(IMAGE, px).mean() > 0.8
    outside = np.array([[-3, -3], [WIDTH + 5, HEIGHT + 5]], np.float32)
    assert has_corner(IMAGE, outside).shape == (2,)


def test_has_corner_accepts_no_points() -> None:
    assert has_corner(IMAGE, NO_POINTS).shape == (0,)


def test_corner_test_does_not_depend_on_contrast() -> None:
    for contrast in (0.3, 1.0):
        for corner in (False, True):
            image = (contrast * drawn(0.4, corner=corner).astype(float)).astype(np.uint8)
            assert has_corner(image, MIDDLE).all() == corner
