"""The kernel that fits the change of disparities against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.kernels.compiled import Reals
from observer.kernels.disparity_change import disparity_change

from .oracles import disparity_change as oracle

CAMERA = StereoCamera(640, 480, 500.0, 501.0, 319.5, 239.5, 0.12)


def seen(seed: int, count: int, known: float) -> tuple[Reals, Reals, Reals, Reals]:
    """Points in two frames; all disparities change, those of a mover much more."""
    rng = np.random.default_rng(seed)
    before, disparity = rng.uniform((0, 0), (639, 479), (count, 2)), rng.uniform(1.5, 40, count)
    x = (before[:, 0] - CAMERA.cx) / CAMERA.fx
    now = before + rng.normal([5.0, 0.0], 1.0, (count, 2))
    moving = np.where(rng.random(count) < 0.2, 6.0, 0.0)
    after = disparity + 0.3 * (1 + x * x) + 1e-3 * disparity**2 + moving
    after += rng.normal(0, 0.1, count)
    after[rng.random(count) > known] = np.nan
    disparity[rng.random(count) > known] = rng.choice([np.nan, 0.5])
    return before, now, disparity, after


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("count", "known"), [(300, 1.0), (301, 0.9), (60, 0.7), (12, 1.0)])
def test_the_fit_matches_numpy(seed: int, count: int, known: float) -> None:
    points = seen(seed, count, known)
    constant, sigma, flow = disparity_change(*points, CAMERA.numbers, 1.0)
    expected = oracle.disparity_change(*points, CAMERA, 1.0)
    assert constant == pytest.approx(expected[0], rel=1e-8, abs=1e-9)
    assert sigma == pytest.approx(expected[1], rel=1e-8)
    np.testing.assert_array_equal(flow, expected[2])


@pytest.mark.parametrize("count", [0, 20])
def test_the_uncertainty_is_infinite_without_disparities(count: int) -> None:
    before, now, disparity, after = seen(0, count, 1.0)
    _, sigma, flow = disparity_change(
        before, now, np.full_like(disparity, np.nan), after, CAMERA.numbers, 1.0
    )
    assert np.isinf(sigma)
    assert len(flow) == 0
