import numpy as np
import pytest

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.coverage import (
    ViewMeasures,
    coverage,
    is_new,
    measure_view,
)

BOARD = Board()
SIZE = (640, 480)


def seen(px: np.ndarray, ids: list[int] | None = None) -> BoardSighting:
    chosen = np.arange(len(px)) if ids is None else np.array(ids)
    return BoardSighting(chosen.astype(np.int32), px[chosen].astype(np.float64))


def grid(step: tuple[float, float], first: tuple[float, float], shear: float = 0.0) -> np.ndarray:
    v, u = np.mgrid[0 : BOARD.rows, 0 : BOARD.columns]
    return np.column_stack(
        [first[0] + step[0] * u.ravel() + shear * v.ravel(), first[1] + step[1] * v.ravel()]
    )


def pair(values: tuple[float, float, float, float], reach: float = 0.0) -> ViewMeasures:
    one = ViewMeasures(np.array(values), np.full(4, reach))
    return one.beside(one)


def test_facing_board_measures_match_hand_computation() -> None:
    # 8 steps of 32 px by 5 of 20 px: an area of 256 x 100 = 160^2 px.
    measured = measure_view(seen(grid((32, 20), (100, 200))), BOARD, SIZE)
    assert measured is not None
    x = (100 + 128 - 80) / (640 - 160)
    y = (200 + 50 - 80) / (480 - 160)
    assert measured.values == pytest.approx([x, y, 160 / np.sqrt(640 * 480), 0.0], abs=1e-9)


def test_skew_is_twice_the_deviation_from_a_right_angle() -> None:
    angle = np.deg2rad(15)
    measured = measure_view(seen(grid((30, 30), (200, 100), shear=30 * np.tan(angle))), BOARD, SIZE)
    assert measured is not None
    assert measured.values[3] == pytest.approx(2 * angle)


def test_reach_is_how_far_corners_extend_in_both_directions() -> None:
    # Corners from the left edge to the middle, and from the upper edge to 3/4 of the way down.
    measured = measure_view(seen(grid((319.5 / 8, 36.0), (0.0, 239.5))), BOARD, SIZE)
    assert measured is not None
    lower = 180 / 240
    assert measured.reach == pytest.approx([0.0, 0.0, lower, 0.0], abs=1e-6)


def test_partial_board_is_measured_by_its_largest_rectangle() -> None:
    whole = grid((40, 40), (100, 100))
    part = [i for i in range(54) if i % 9 >= 3 and i // 9 <= 3] + [53]
    measured = measure_view(seen(whole, sorted(set(part))), BOARD, SIZE)
    assert measured is not None
    assert measured.values[2] == pytest.approx(np.sqrt(5 * 3 * 40 * 40 / (640 * 480)))
    in_a_line = list(range(9))
    assert measure_view(seen(whole, in_a_line), BOARD, SIZE) is None


def test_bars_measure_coverage_of_the_required_ranges() -> None:
    covered = coverage([pair((0.3, 0.2, 0.1, 0.05)), pair((0.65, 0.9, 0.3, 0.1))])
    assert covered.bars == pytest.approx({"X": 0.5, "Y": 1.0, "Size": 0.75, "Skew": 0.2})
    assert not covered.enough


def test_camera_with_less_coverage_counts() -> None:
    wide = [ViewMeasures(np.array([x, x, 0.5, 0.6]), np.ones(4)) for x in (0.1, 0.9)]
    narrow = [ViewMeasures(np.array([x, 0.5, 0.2, 0.6]), np.zeros(4)) for x in (0.3, 0.65)]
    covered = coverage([a.beside(b) for a, b in zip(wide, narrow, strict=True)])
    assert covered.bars == pytest.approx({"X": 0.5, "Y": 0.0, "Size": 0.5, "Skew": 1.0})
    assert set(covered.reached.values()) == {0.0}


def test_view_is_new_beyond_a_distance_of_one_fifth() -> None:
    kept = [pair((0.5, 0.5, 0.3, 0.1))]
    assert not is_new(pair((0.6, 0.45, 0.3, 0.14)), kept)
    assert is_new(pair((0.6, 0.4, 0.3, 0.11)), kept)
    assert is_new(pair((0.5, 0.5, 0.3, 0.1)), [])


def test_enough_needs_full_bars_and_some_views_or_many_views() -> None:
    corners = [pair((x, y, 0.5, 0.6), 1.0) for x in (0.1, 0.9) for y in (0.1, 0.9)]
    few = coverage(corners)
    assert min(few.bars.values()) == 1
    assert not few.enough
    assert few.missing == ("8 more views",)
    assert coverage(3 * corners).enough
    poor = [pair((0.5, 0.5, 0.2, 0.0))]
    assert not coverage(39 * poor).enough
    assert coverage(40 * poor).enough


def test_no_views_give_no_coverage() -> None:
    none = coverage([])
    assert set(none.bars.values()) == {0.0}
    assert "a view with the board tilted" in none.missing
    assert "the upper left corner of the image" in none.missing
