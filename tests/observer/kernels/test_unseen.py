"""The kernels for unseen regions against numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.kernels.unseen import background, cell_means, fills, told_by_points

from .oracles import unseen as oracle

SHAPES = [(16, 32), (9, 7), (1, 1), (23, 40)]
each_shape = pytest.mark.parametrize("shape", SHAPES)
each_seed = pytest.mark.parametrize("seed", range(6))


def shares(rng: np.random.Generator, shape: tuple[int, int], zero: float) -> oracle.Weights:
    """Shares per cell in steps of 1/64, a share ``zero`` of them 0."""
    parts = rng.integers(0, 65, shape) * (rng.random(shape) >= zero)
    return (parts / 64).astype(np.float32)


def blobs(rng: np.random.Generator, shape: tuple[int, int], share: float) -> oracle.Mask:
    """Patches of three by two cells, and some single ones."""
    rows, columns = shape
    coarse = rng.random((rows // 3 + 1, columns // 2 + 1)) < share
    wide = np.repeat(np.repeat(coarse, 3, axis=0), 2, axis=1)[:rows, :columns]
    out: oracle.Mask = wide ^ (rng.random(shape) < 0.05)
    return out


@pytest.mark.parametrize("shape", [(16, 24), (17, 31), (5, 3), (120, 160)])
@pytest.mark.parametrize("side", [8, 4])
def test_cell_means_match_opencv(shape: tuple[int, int], side: int) -> None:
    values = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    np.testing.assert_array_equal(cell_means(values, side), oracle.cell_means(values, side))


@each_seed
@each_shape
@pytest.mark.parametrize("count", [0, 5, 200])
def test_evidence_from_points_matches_numpy(seed: int, shape: tuple[int, int], count: int) -> None:
    rng = np.random.default_rng(seed)
    known, stands, moves = (shares(rng, shape, 0.5) for _ in range(3))
    # Some points lie a little outside.
    px = (rng.uniform(-0.05, 1.05, (count, 2)) * (16 * shape[1], 16 * shape[0])).astype(np.float32)
    dynamic = rng.random(count) < 0.3
    cells = np.maximum(px // 16, 0).astype(np.intp)
    at = (np.minimum(cells[:, 1], shape[0] - 1), np.minimum(cells[:, 0], shape[1] - 1))
    least = np.float32(0.25)
    found = told_by_points(known, stands, moves, px, dynamic, np.float32(16), least)
    wanted = oracle.told_by_points(known, stands, moves, at, dynamic, least)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(one, other)


@each_seed
@each_shape
@pytest.mark.parametrize("share", [0.0, 0.4, 0.8, 1.1])
def test_the_background_matches_numpy(seed: int, shape: tuple[int, int], share: float) -> None:
    rng = np.random.default_rng(seed)
    plain = blobs(rng, shape, share)
    stands = shares(rng, shape, 0.2)
    moves = np.where(blobs(rng, shape, 0.15), shares(rng, shape, 0.1), np.float32(0))
    for fits in ((6, 3), (1, 1), (40, 40)):
        count, regions = cv2.connectedComponents(plain.view(np.uint8), connectivity=4)
        found = background(regions.astype(np.int64), count, stands, moves, *fits)
        np.testing.assert_array_equal(found, oracle.background(plain, stands, moves, fits))


@each_seed
@each_shape
@pytest.mark.parametrize("fits", [(6, 3), (1, 1), (40, 40)])
def test_fills_matches_numpy(seed: int, shape: tuple[int, int], fits: tuple[int, int]) -> None:
    cells = blobs(np.random.default_rng(seed), shape, 0.3)
    for share in (0.25, 0.5, 1.0):
        assert fills(cells, *fits, share) == oracle.fills(cells, fits, share)
    nothing: NDArray[np.bool_] = np.zeros(shape, np.bool_)
    assert not fills(nothing, *fits, 0.01)
