"""The kernels of segments against numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.kernels.segments import described, grown

from .oracles import segments as oracle

SHAPE = (36, 54)
TRUNK_SHARE = 0.6


def patches(
    rng: np.random.Generator, values: list[float], rows: int, columns: int
) -> NDArray[np.float64]:
    """(h, w) a blocky image of some values."""
    coarse = rng.choice(values, (rows, columns))
    return np.asarray(cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_NEAREST), np.float64)


def a_scene(seed: int) -> oracle.Scene:
    """Depths in patches with noise; holes and evidence in other patches."""
    rng = np.random.default_rng(seed)
    disparity = patches(rng, [9.0, 20.0, 20.5, 33.0], 5, 7) + rng.normal(0, 0.2, SHAPE)
    disparity[rng.random(SHAPE) < 0.04] = np.nan
    disparity[patches(rng, [0.0, 0.0, 1.0], 4, 9) > 0] = np.nan
    return oracle.Scene(
        disparity=disparity.astype(np.float32),
        evidence=patches(rng, [0.0, 1.0, 2.0, 2.0, 3.0], 8, 6).astype(np.uint8),
        standing=np.isfinite(disparity) & (rng.random(SHAPE) < 0.97),
        reduction=2,
        least_step=1.0,
        least_tolerance=1.3,
        thickness=0.008,
    )


def by_kernel(
    scene: oracle.Scene,
    free: oracle.Mask,
    seed: oracle.Mask,
    may_be_static: oracle.Mask,
    disparity: float,
) -> tuple[oracle.Mask, int]:
    tolerance = np.float32(scene.tolerance(disparity))
    return grown(scene.disparity, scene.evidence, free, seed, may_be_static,
                 np.float32(disparity), tolerance)  # fmt: skip


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("disparity", [9.0, 20.2, 33.0, 60.0])
@pytest.mark.parametrize("holes", [0.0, 0.03, 0.3])
def test_connected_cells_match_opencv(seed: int, disparity: float, holes: float) -> None:
    rng, scene = np.random.default_rng(seed), a_scene(seed)
    free = rng.random(SHAPE) >= holes
    of_seed = patches(rng, [0.0, 1.0], 3, 4) > 0
    may_be_static = patches(rng, [0.0, 1.0], 5, 5) > 0
    wanted = oracle.grown(scene, free, of_seed, may_be_static, disparity)
    mask, count = by_kernel(scene, free, of_seed, may_be_static, disparity)
    assert count == np.count_nonzero(wanted)
    if count:
        np.testing.assert_array_equal(mask, wanted)


@pytest.mark.parametrize("rows", [slice(0, 3), slice(33, 36), slice(0, 36), slice(9, 10)])
@pytest.mark.parametrize("columns", [slice(0, 3), slice(51, 54), slice(0, 54), slice(20, 21)])
def test_opening_of_border_bars_and_thin_bars_matches_opencv(rows: slice, columns: slice) -> None:
    scene, ones = a_scene(0), np.ones(SHAPE, np.bool_)
    scene.disparity[:] = 9.0
    scene.disparity[rows, columns] = 20.0
    scene.disparity[12:16, 30:36] = 20.0
    wanted = oracle.grown(scene, ones, ones, ones, 20.0)
    mask, count = by_kernel(scene, ones, ones, ones, 20.0)
    assert count == np.count_nonzero(wanted) > 0
    np.testing.assert_array_equal(mask, wanted)


def masks(seed: int) -> list[oracle.Mask]:
    """Masks with known depth: inside, at the border, in parts, a single cell, and everything."""
    rng, scene = np.random.default_rng(seed), a_scene(seed)
    known = np.isfinite(scene.disparity)
    blobs = [np.zeros(SHAPE, np.bool_) for _ in range(4)]
    blobs[0][8:30, 15:27] = True
    blobs[1][20:, 40:] = True
    blobs[2][:, :9] = patches(rng, [0.0, 1.0], 6, 20)[:, :9] > 0
    blobs[3][:] = True
    single = np.zeros(SHAPE, np.bool_)
    row, column = np.argwhere(known)[rng.integers(0, np.count_nonzero(known))]
    single[row, column] = True
    return [mask & known for mask in (*blobs, single) if (mask & known).any()]


@pytest.mark.parametrize("seed", range(12))
def test_segment_descriptions_match_numpy(seed: int) -> None:
    scene = a_scene(seed)
    for mask in masks(seed):
        rows, columns = oracle.window_of(mask)
        numbers, evidence, border, cut = described(
            mask,
            np.array([columns.start, rows.start, columns.stop, rows.stop]),
            scene.disparity,
            scene.evidence,
            scene.standing,
            scene.reduction,
            TRUNK_SHARE,
            scene.least_step,
            scene.least_tolerance,
            scene.thickness,
        )
        wanted = oracle.described(scene, mask, TRUNK_SHARE)
        np.testing.assert_allclose(numbers, wanted.numbers, rtol=0)
        np.testing.assert_array_equal(evidence, wanted.evidence)
        np.testing.assert_array_equal(border, wanted.border)
        np.testing.assert_array_equal(cut, wanted.cut)
