"""The kernels that choose corners against the same choice by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.corners import is_cornered, strongest_of_cells, wanted_cells

from .oracles import corners as oracle

FINER = 2


def cells(seed: int, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of taken cells, some of a kind that does not count there, and marked cells."""
    rng = np.random.default_rng(seed)
    marked = rng.random((rows, columns)) < rng.choice([0.0, 0.3, 1.0])
    number = rows * columns * (1 + FINER**2)
    taken = rng.integers(0, number, int(number * rng.choice([0.0, 0.3, 2.0])))
    return taken, marked


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_wanted_cells_match_numpy(seed: int, turns: int) -> None:
    rows, columns = 1 + seed % 5, 2 + seed % 7
    taken, marked = cells(seed, rows, columns)
    arguments = taken, marked, FINER, seed, turns
    np.testing.assert_array_equal(wanted_cells(*arguments), oracle.wanted_cells(*arguments))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("spacing", "levels"), [(7, 1000), (16, 1000), (25, 1000), (16, 3)])
def test_the_strongest_pixel_of_each_cell_matches_numpy(
    seed: int, spacing: int, levels: int
) -> None:
    """Few levels of strength cause ties."""
    rng = np.random.default_rng(seed)
    height, width = int(rng.integers(20, 60)), int(rng.integers(20, 60))
    strength = (rng.integers(0, levels, (height, width)) / levels).astype(np.float32)
    rows, columns = -(-2 * height // spacing), -(-2 * width // spacing)
    taken, marked = cells(seed, rows, columns)
    wanted = oracle.wanted_cells(taken, marked, FINER, seed, 2)
    step = np.float32(2 * FINER / spacing)
    for margin, least in ((5, 0.3), (0, 0.3), (9, 0.999), (5, 1.0)):
        arguments = strength, marked, wanted, FINER, margin, step, np.float32(least)
        np.testing.assert_array_equal(
            strongest_of_cells(*arguments), oracle.strongest_of_cells(*arguments)
        )


def test_no_pixel_without_strength_or_beyond_the_margins_is_chosen() -> None:
    marked, wanted = np.zeros((4, 4), np.bool_), np.ones((8, 8), np.bool_)
    flat, steep = np.zeros((30, 30), np.float32), np.ones((30, 30), np.float32)
    step, nothing = np.float32(0.25), np.float32(0.0)
    assert len(strongest_of_cells(flat, marked, wanted, FINER, 5, step, nothing)) == 0
    found = strongest_of_cells(steep, marked, wanted, FINER, 5, step, nothing)
    assert len(found) == 16
    assert found.min() == 5
    assert len(strongest_of_cells(steep, marked, wanted, FINER, 15, step, nothing)) == 0
    assert len(strongest_of_cells(steep, marked, wanted, FINER, 20, step, nothing)) == 0


@pytest.mark.parametrize("seed", range(20))
def test_distinguishing_corners_from_edges_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    height, width = int(rng.integers(4, 30)), int(rng.integers(4, 30))
    angle = rng.uniform(0, np.pi)
    along = rng.normal(0, 300, (height, width))
    across, down = (
        np.rint(np.clip(along * part + rng.normal(0, 60, (height, width)), -1020, 1020))
        for part in (np.cos(angle), np.sin(angle))
    )
    px = rng.uniform(-3, (2 * width + 3, 2 * height + 3), (200, 2)).astype(np.float32)
    arguments = across.astype(np.int16), down.astype(np.int16), px, 2, 7, 0.05
    expected = oracle.is_cornered(*arguments)
    np.testing.assert_array_equal(is_cornered(*arguments), expected)


def test_largest_gradients_do_not_overflow_and_flat_areas_are_not_edges() -> None:
    steep = np.full((20, 20), -1020, np.int16)
    px = np.array([[10.0, 10.0], [39.0, 0.0]], np.float32)
    assert not is_cornered(steep, steep, px, 2, 7, 0.05).any()
    flat = np.zeros_like(steep)
    assert not is_cornered(steep, flat, px, 2, 7, 0.05).any()
    assert is_cornered(flat, flat, px, 2, 7, 0.05).all()
    assert is_cornered(flat, flat, px[:0], 2, 7, 0.05).shape == (0,)
