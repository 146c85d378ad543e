"""The kernels for the ground against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.kernels.ground import fit_ground, nearer_downwards, stands_out
from observer.methods.rigid.dense.grid import Grid

from .oracles import ground as oracle

GRID = Grid(StereoCamera(160, 120, 110.0, 111.0, 78.0, 61.0, 0.12), 2, 80, 60, 2)
FOCAL = GRID.camera.fx * GRID.camera.baseline
SLACK, SLACK_SHARE = 0.5, 0.03
each_seed = pytest.mark.parametrize("seed", range(8))


def ground_below(height_m: float, pitch: float, roll: float) -> Float64Array:
    """(3,) plane of the ground's disparity below a camera, see ``fit_ground``."""
    down = np.array([np.sin(roll), np.cos(roll) * np.cos(pitch), np.sin(pitch)])
    return np.asarray(FOCAL / height_m * (down / np.linalg.norm(down)) @ GRID.rays)


def seen_ground(rng: np.random.Generator, plane: Float64Array, other: float) -> Float64Array:
    """(h, w) px of the ground, a share of it hidden by something else, with noise and holes."""
    rows, columns = np.indices(GRID.shape)
    disparity = np.maximum(plane[0] * columns + plane[1] * rows + plane[2], 0.5)
    disparity = np.where(rng.random(GRID.shape) < other, rng.uniform(1, 20, GRID.shape), disparity)
    disparity += rng.normal(0, 0.1, GRID.shape)
    disparity[rng.random(GRID.shape) < 0.1] = np.nan
    return disparity


@each_seed
@pytest.mark.parametrize(("top", "half", "step"), [(15, 4, 2), (0, 1, 1), (16, 3, 3), (50, 4, 2)])
def test_cells_nearer_downwards_match_numpy(seed: int, top: int, half: int, step: int) -> None:
    rng = np.random.default_rng(seed)
    disparity = seen_ground(rng, ground_below(0.4, 0.2, 0.0), 0.3).astype(np.float32)
    found = nearer_downwards(disparity, top, half, step, np.float32(0.3))
    wanted = oracle.nearer_downwards(disparity, top, half, step, 0.3)
    np.testing.assert_array_equal(found, wanted)


def by_kernel(
    at: NDArray[np.intp],
    seen: Float64Array,
    triples: NDArray[np.intp],
    expected: Float64Array | None,
) -> Float64Array:
    none = np.zeros(3)
    plane = none if expected is None else expected
    tried = triples if expected is None else triples[:0]
    return fit_ground(at, seen, GRID.width, SLACK, SLACK_SHARE, tried, plane, GRID.rays, FOCAL)


@each_seed
@pytest.mark.parametrize("other", [0.0, 0.3, 0.45, 0.9])
@pytest.mark.parametrize("pose", [(0.4, 0.2, 0.0), (1.0, 0.5, 0.1), (0.3, 0.1, 0.8), (9.0, 0.2, 0)])
@pytest.mark.parametrize("known", [False, True])
def test_the_ground_matches_numpy(
    seed: int, other: float, pose: tuple[float, float, float], *, known: bool
) -> None:
    """Also if too little is ground, or a similar plane is tilted or too far below."""
    rng = np.random.default_rng(seed)
    plane = ground_below(*pose)
    disparity = seen_ground(rng, plane, other).ravel()
    at = rng.choice(np.flatnonzero(np.isfinite(disparity)), 400)
    seen = disparity[at]
    triples = rng.integers(0, len(at), (40, 3))
    triples[0] = 7
    expected = plane * rng.normal(1, 0.02, 3) if known else None
    places = np.column_stack([at % GRID.width, at // GRID.width, np.ones_like(at)])
    wanted = oracle.fit_ground(
        GRID, places.astype(np.float64), seen, SLACK + SLACK_SHARE * seen, triples, expected
    )
    found = by_kernel(at, seen, triples, expected)
    if wanted is None:
        assert np.isnan(found).all()
    else:
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-10)


def test_the_ground_is_found_despite_occluders() -> None:
    rng = np.random.default_rng(0)
    disparity = seen_ground(rng, ground_below(0.4, 0.2, 0.05), 0.3).ravel()
    at = rng.choice(np.flatnonzero(np.isfinite(disparity)), 600)
    normal = by_kernel(at, disparity[at], rng.integers(0, 600, (60, 3)), None)
    assert 1 / np.linalg.norm(normal) == pytest.approx(0.4, rel=0.05)


def test_collinear_cells_have_no_plane() -> None:
    at = np.full(300, 40 * GRID.width) + np.arange(300) % GRID.width
    seen = np.full(300, 10.0)
    triples = np.random.default_rng(0).integers(0, 300, (40, 3))
    assert np.isnan(by_kernel(at, seen, triples, None)).all()
    assert np.isnan(by_kernel(at, seen, triples, np.array([0.0, 0.2, 2.0]))).all()


@each_seed
@pytest.mark.parametrize("pose", [(0.4, 0.2, 0.0), (1.0, 0.5, 0.3), (0.3, -0.4, 0.0)])
def test_cells_that_stand_out_match_numpy(seed: int, pose: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(seed)
    plane = ground_below(*pose)
    disparity = seen_ground(rng, plane, 0.3).astype(np.float32)
    limits = np.float32(0.95), np.float32(0.6)
    found = stands_out(disparity, plane.astype(np.float32), *limits)
    wanted = oracle.stands_out(disparity, plane.astype(np.float32), *limits)
    np.testing.assert_array_equal(found, wanted)
