"""The kernel for the bias of dense disparities against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.methods.rigid.dense.corrections import with_bias
from observer.methods.rigid.dense.grid import Grid

from .oracles import corrections as oracle


@pytest.mark.parametrize("reduction", [2, 3])
@pytest.mark.parametrize("bias_px", [0.0, 0.37, -1.2])
def test_adding_a_bias_matches_numpy(reduction: int, bias_px: float) -> None:
    camera = StereoCamera(64 * reduction, 40 * reduction, 90.0, 91.0, 61.2, 39.8, 0.12)
    grid = Grid(camera, reduction, 64, 40, reduction)
    disparity = np.random.default_rng(0).uniform(0, 40, grid.shape).astype(np.float32)
    disparity[:, 20:25] = np.nan
    found = with_bias(disparity, bias_px, grid)
    np.testing.assert_array_equal(found, oracle.with_bias(disparity, bias_px, grid))
