"""Obstacles drawn on images whose every pixel is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from observer.drawing import (
    DrawnObstacle,
    color_copy,
    draw_obstacles,
    draw_text,
    obstacle_color,
    silhouette_mask,
    tint,
)
from observer.obstacle_colors import OBSTACLE_RGB
from observer.types import MotionState, TrackState

GREY = 80
# A triangle in a larger box.
TRIANGLE = np.array([[60.0, 40.0], [100.0, 140.0], [20.0, 140.0]])
BOX = (10.0, 30.0, 110.0, 150.0)
COLOR = obstacle_color(TrackState.CONFIRMED, MotionState.MOVING)


def canvas() -> np.ndarray:
    return np.full((200, 300, 3), GREY, np.uint8)


def drawn(*silhouette: np.ndarray) -> np.ndarray:
    image = canvas()
    draw_obstacles(image, [DrawnObstacle(BOX, silhouette or None, "", COLOR)])
    return image


def test_the_silhouette_is_outlined_and_tinted_within_the_box() -> None:
    image = drawn(TRIANGLE)
    # Anti-aliased lines are a little paler.
    assert image[140, 60].tolist() == pytest.approx(list(COLOR), abs=20), "its lower edge"
    assert image[90, 10].tolist() == list(COLOR), "the box's left edge"
    within = image[110, 60].astype(int)
    assert within.tolist() == [round(0.75 * GREY + 0.25 * part) for part in COLOR]
    assert image[60, 90].tolist() == [GREY] * 3, "in the box, beside the silhouette"
    assert image[180, 200].tolist() == [GREY] * 3


def test_all_parts_of_a_silhouette_are_drawn() -> None:
    other = TRIANGLE + np.array([120.0, 0.0])
    image = drawn(TRIANGLE, other)
    assert np.array_equal(image[110, 60], image[110, 180])
    assert np.array_equal(image[140, 60], image[140, 180])


def test_only_the_box_is_drawn_without_a_silhouette() -> None:
    image = drawn()
    inner = image[35:145, 15:105]
    assert (inner == GREY).all()
    assert image[90, 10].tolist() == list(COLOR)


@pytest.mark.parametrize("reach", [0, 400])
def test_an_obstacle_beyond_the_image_border_is_clipped(reach: int) -> None:
    image = canvas()
    outline = np.array(
        [[250.0, 50.0], [290.0 + reach, 50.0], [290.0 + reach, 100.0], [250.0, 100.0]]
    )
    draw_obstacles(
        image, [DrawnObstacle((250.0, 50.0, 290.0 + reach, 100.0), [outline], "#1", COLOR)]
    )
    assert image[75, 270].tolist() != [GREY] * 3


def test_each_state_has_a_colour_of_its_own_and_motion_out_of_view_has_none() -> None:
    colors = {obstacle_color("confirmed", motion) for motion in MotionState}
    assert len(colors) == len(MotionState)
    coasting = {obstacle_color("coasting", motion) for motion in MotionState}
    assert len(coasting) == 1
    assert not coasting & colors


@pytest.mark.parametrize("background", ["#f4f7f5", "#0d1413"])
def test_each_state_stands_out_from_the_scene(background: str) -> None:
    def luminance(rgb: Sequence[int]) -> float:
        linear = [
            part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
            for part in (channel / 255 for channel in rgb)
        ]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722))) + 0.05

    ground = luminance(bytes.fromhex(background[1:]))
    for state, rgb in OBSTACLE_RGB.items():
        lower, higher = sorted((luminance(rgb), ground))
        assert higher / lower >= 3.0, state


def test_a_mask_on_a_coarser_grid_covers_the_same_area() -> None:
    square = np.array([[40.0, 20.0], [79.0, 20.0], [79.0, 99.0], [40.0, 99.0]])
    coarse = silhouette_mask([square], (50, 75), 4)
    truth = np.zeros((50, 75), np.bool_)
    truth[5:25, 10:20] = True
    assert np.array_equal(coarse, truth)


def test_a_tint_changes_only_its_mask_by_its_share() -> None:
    image, mask = canvas(), np.zeros((200, 300), np.bool_)
    mask[3, 4] = True
    tint(image, mask, (0, 100, 255), 0.5)
    assert image[3, 4].tolist() == [40, 90, 168]
    assert (image[~mask] == GREY).all()
    untouched = canvas()
    tint(untouched, np.zeros((200, 300), np.bool_), (0, 100, 255), 0.5)
    assert (untouched == GREY).all()


def test_a_grey_image_is_copied_to_color() -> None:
    grey = np.full((4, 5), 7, np.uint8)
    copied = color_copy(grey)
    assert copied.shape == (4, 5, 3)
    copied[:] = 0
    assert (grey == 7).all()


@pytest.mark.parametrize("box", [(-90, 50, -10, 99), (310, 50, 390, 99), (10, 210, 60, 300)])
def test_an_obstacle_out_of_view_is_not_drawn(box: tuple[float, ...]) -> None:
    image = canvas()
    draw_obstacles(image, [DrawnObstacle(box, None, "#1", COLOR)])
    assert (image == GREY).all()


def test_a_plus_minus_sign_is_a_plus_above_a_line() -> None:
    plain, signed = canvas(), canvas()
    draw_text(plain, "0.40 + 0.02", (10, 100), COLOR, 1.0)
    draw_text(signed, "0.40 ± 0.02", (10, 100), COLOR, 1.0)
    rows = np.flatnonzero((plain != signed).any(axis=(1, 2)))
    columns = np.flatnonzero((plain != signed).any(axis=(0, 2)))
    assert len(rows) > 0, "the font alone writes question marks"
    assert rows.min() >= 100, "nothing but a line below the plus"
    assert columns.max() - columns.min() < 25


@pytest.mark.parametrize("top", [100.0, 2.0])
def test_the_texts_of_neighbours_do_not_cover_each_other(top: float) -> None:
    """The text of the first reaches over the box of the second, also at the upper edge."""
    neighbours = [
        DrawnObstacle((left, top, left + 20.0, top + 60.0), None, "#1  0.40 m/s", (0, 0, 0))
        for left in (20.0, 60.0)
    ]

    def letters(obstacles: list[DrawnObstacle]) -> int:
        image = canvas()
        draw_obstacles(image, obstacles)
        # Anti-aliased letters are darker than their colour.
        return int((image.min(axis=2) > 120).sum())

    alone = [letters([each]) for each in neighbours]
    assert min(alone) > 20
    assert letters(neighbours) == sum(alone)


@pytest.mark.parametrize("left", [-30.0, 290.0])
def test_the_text_of_an_obstacle_at_the_border_is_whole(left: float) -> None:
    box = (left, 100.0, left + 40.0, 150.0)
    inks = []
    for each in (box, (100.0, 100.0, 140.0, 150.0)):
        image = canvas()
        draw_obstacles(image, [DrawnObstacle(each, None, "#1  0.40 m/s", COLOR)])
        inks.append((image[:95, ..., 2] > 120).sum())
    assert inks[0] == inks[1] > 20
