"""The kernel that searches rows for single points against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.row_search import contradicted_by_rows, least_differences, search_rows

from .oracles import row_search as oracle

HEIGHT, WIDTH, SIDE, REDUCTION = 40, 60, 9, 2
UNIQUENESS, LEAST_GAP, RECURRENCE = np.float32(0.1), np.float32(40.5), np.float32(0.25)
NEAR_PX = np.float32(2.5)


def pair(seed: int, count: int, levels: int, period: int) -> tuple[np.ndarray, np.ndarray]:
    """Two images, the second shifted; few grey levels and repetitions cause ties."""
    rng = np.random.default_rng(seed)
    wide = rng.integers(0, levels, (HEIGHT + SIDE - 1, period)) * (62 // (levels - 1))
    wide = np.tile(wide, (1, 400 // period + 1)).astype(np.uint8)
    wide[::5] = rng.integers(0, 63, wide[::5].shape)
    shift = int(rng.integers(0, count + 1))
    first = wide[:, 100 : 100 + WIDTH + SIDE - 1]
    second = wide[:, 100 + shift - count : 100 + shift + WIDTH + SIDE - 1].astype(np.int64)
    second = np.clip(second + rng.integers(-3, 4, second.shape), 0, 62).astype(np.uint8)
    return np.ascontiguousarray(first), second


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("count", "levels", "period"),
    [(24, 63, 400), (24, 2, 400), (48, 63, 7), (1, 63, 400), (0, 9, 9)],
)
def test_the_row_search_matches_numpy(seed: int, count: int, levels: int, period: int) -> None:
    first, second = pair(seed, count, levels, period)
    rng = np.random.default_rng(seed)
    px = rng.uniform((0, 0), (2 * WIDTH - 1, 2 * HEIGHT - 1), (60, 2)).astype(np.float32)
    # Half pixels of the smaller image round to even; the last ones lie at and beyond its edge.
    px[:20] = np.rint(px[:20])
    px[-3:] = [[0, 0], [2 * WIDTH - 1, 2 * HEIGHT - 1], [2 * WIDTH + 5, 2 * HEIGHT + 5]]
    how = REDUCTION, SIDE, count, UNIQUENESS, LEAST_GAP
    arguments = first, second, px, *how, RECURRENCE
    for mine, its in zip(search_rows(*arguments), oracle.search_rows(*arguments), strict=True):
        np.testing.assert_array_equal(mine, its)
    held = rng.uniform(0, 2 * count, len(px)).astype(np.float32)
    held[:15] = search_rows(first, second, px[:15], *how, RECURRENCE)[0]
    known = first, second, px, held, *how, NEAR_PX
    expected = oracle.contradicted_by_rows(*known)
    np.testing.assert_array_equal(contradicted_by_rows(*known), expected)


def test_flat_images_and_empty_input_give_no_disparity() -> None:
    flat = np.full((HEIGHT + SIDE - 1, WIDTH + SIDE - 1), 31, np.uint8)
    wide = np.full((HEIGHT + SIDE - 1, WIDTH + SIDE - 1 + 24), 31, np.uint8)
    px = np.array([[50.0, 20.0], [119.0, 79.0]], np.float32)
    for some in (px, px[:0]):
        how = REDUCTION, SIDE, 24, UNIQUENESS, LEAST_GAP
        found, recurs = search_rows(flat, wide, some, *how, RECURRENCE)
        assert found.dtype == np.float32
        assert found.shape == (len(some),)
        assert np.isnan(found).all()
        assert not recurs.any()
        held = np.full(len(some), 8.0, np.float32)
        assert not contradicted_by_rows(flat, wide, some, held, *how, NEAR_PX).any()


@pytest.mark.parametrize("seed", range(4))
def test_the_least_differences_match_numpy(seed: int) -> None:
    first, second = pair(seed, 24, 63, 17)
    rng = np.random.default_rng(seed)
    cells = rng.integers((-2, -2), (WIDTH + 10, HEIGHT + 10), (80, 2))
    lowest = rng.integers(0, 20, 80)
    highest = lowest + rng.integers(-1, 12, 80)
    least = least_differences(first, second, cells, lowest, highest, SIDE)
    expected = oracle.least_differences(first, second, cells, lowest, highest, SIDE)
    assert np.isinf(expected).any()
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(least, expected, rtol=1e-6)
