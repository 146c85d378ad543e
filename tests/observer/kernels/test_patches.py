"""The kernel of connected cells against the same by numpy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.kernels.patches import describe_patches

from .oracles import patches as oracle


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.9, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_patch_descriptions_match_numpy(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    changed = (rng.random((24, 31)) < share).astype(np.uint8)
    disparity = rng.uniform(1.0, 60.0, changed.shape).astype(np.float32)
    disparity[changed == 0] = np.nan
    _, labels, stats, middles = cv2.connectedComponentsWithStats(changed, connectivity=8)
    arguments = (
        np.asarray(labels, np.int32), np.asarray(stats, np.int32),
        np.asarray(middles, np.float64), disparity,
    )  # fmt: skip
    typical, nearest = describe_patches(*arguments)
    wanted, wanted_nearest = oracle.describe_patches(*arguments)
    np.testing.assert_array_equal(typical, wanted)
    np.testing.assert_array_equal(nearest, wanted_nearest)
