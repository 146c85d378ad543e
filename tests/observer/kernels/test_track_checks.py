"""The kernels that check tracked points against the same checks by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.track_checks import around_the_circle, on_the_row, with_returned

from .oracles import track_checks as oracle
from .oracles.track_checks import Flow

COUNT = 200
HEIGHT, WIDTH = 96, 128
UNIT, DEVIATION, LEAST = (np.float32(v) for v in (1024.0, 1.2533141, 1e-3))
single = np.float32


def pixels(rng: np.random.Generator) -> np.ndarray:
    """Pixels, some on the edges of the image and of the margin, a few outside."""
    px = rng.uniform((-3, -3), (WIDTH + 2, HEIGHT + 2), (COUNT, 2))
    px[:40] = rng.choice([0.0, 3.75, WIDTH - 1.0, WIDTH - 4.75, HEIGHT - 1.0, 40.0], (40, 2))
    return px.astype(np.float32)


def flow(rng: np.random.Generator, px: np.ndarray, noise: float = 0.4) -> Flow:
    """Points found near pixels (N, 2), some of them lost, with NaN results."""
    found = rng.random(len(px)) < 0.85
    end = px + rng.normal(0, noise, px.shape).astype(np.float32)
    quality = rng.uniform(-0.1, 30, len(px)).astype(np.float32)
    end[~found], quality[~found] = np.nan, np.nan
    return Flow(end, found.astype(np.uint8), quality)


@pytest.mark.parametrize("seed", range(10))
def test_the_forward_backward_check_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    end, found = pixels(rng), rng.random(COUNT) < 0.5
    difference, texture = rng.uniform(0, 9, (2, COUNT)).astype(np.float32)
    at = np.flatnonzero(~found)[: [0, 1, COUNT][seed % 3]]
    start = pixels(rng)[at]
    there = flow(rng, start)
    back = flow(rng, start)
    results = with_returned(
        end, found, difference, texture, at, start, there.px, there.status, there.quality,
        back.px, back.status, back.quality, HEIGHT, WIDTH,
        single(3.75), UNIT, single(0.5**2), single(20.0),
    )  # fmt: skip
    passed = oracle.returned(start, there, back, (HEIGHT, WIDTH), 3.75, float(UNIT), 0.5, 20.0)
    expected = end.copy(), found.copy(), difference.copy(), texture.copy()
    for array, values in zip(expected, (there.px, *passed), strict=True):
        np.asarray(array)[at] = values
    for result, other in zip(map(np.asarray, results), map(np.asarray, expected), strict=True):
        assert result.dtype == other.dtype
        np.testing.assert_array_equal(result, other)


@pytest.mark.parametrize("seed", range(10))
def test_the_row_check_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    px = pixels(rng)
    disparity = rng.uniform(0, 9, COUNT).astype(np.float32)
    disparity[rng.random(COUNT) < 0.2] = np.nan
    match = flow(rng, px)
    matched, difference = on_the_row(
        px, disparity, match.px, match.status, match.quality, HEIGHT, WIDTH, single(0.5), single(20)
    )
    expected = oracle.on_the_row(px, disparity, match, (HEIGHT, WIDTH), 0.5, 20.0)
    assert 10 < np.isfinite(matched[:, 0]).sum() < 190
    np.testing.assert_array_equal(matched, expected[0])
    np.testing.assert_array_equal(difference, expected[1])


@pytest.mark.parametrize("seed", range(10))
def test_comparison_of_both_paths_to_the_right_image_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    difference, texture = rng.uniform(0, 20, (2, COUNT)).astype(np.float32)
    texture[::9] = 0.0
    at = np.flatnonzero(rng.random(COUNT) < [0.0, 0.7, 1.0][seed % 3])
    matched = pixels(rng)[at]
    matched[rng.random(len(at)) < 0.2] = np.nan
    mismatch = rng.uniform(0, 20, len(at)).astype(np.float32)
    circle = np.flatnonzero(np.isfinite(matched[:, 0]) & (rng.random(len(at)) < 0.8))
    around = flow(rng, matched[circle], 0.7)
    right, sigma = around_the_circle(
        difference, texture, at, matched, mismatch, circle, around.px, around.status,
        single(1.0), single(15), LEAST, DEVIATION, single(1.5), single(0.05),
    )  # fmt: skip
    expected = oracle.around_the_circle(
        difference, texture, at, matched, mismatch, circle, around,
        1.0, 15, float(LEAST), float(DEVIATION), 1.5, 0.05,
    )  # fmt: skip
    np.testing.assert_array_equal(right, expected[0])
    np.testing.assert_allclose(sigma, expected[1], rtol=2e-7)
