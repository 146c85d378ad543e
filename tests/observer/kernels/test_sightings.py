"""The kernels for sightings of tracked points against the same formulas by numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.kernels.sightings import placed_in_world, seen_again

from .oracles import sightings as oracle

CAMERA = StereoCamera(512, 256, 300.0, 301.0, 255.0, 127.0, 0.12)
POSE = Pose.from_rotvec([0.3, -0.2, 0.1], [1.0, -0.5, 2.0])
COUNT = 120


def pixels(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform((0, 0), (511, 255), (COUNT, 2)).astype(np.float32)


def some(rng: np.random.Generator, values: np.ndarray, known: float = 0.8) -> np.ndarray:
    """The values, with NaN for some of the points."""
    out = values.copy()
    out[rng.random(COUNT) > known] = np.nan
    return out


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("skew_s", [None, 0.0, 0.004])
@pytest.mark.parametrize("bias_px", [0.0, 0.7])
def test_measurements_of_points_seen_again_match_numpy(
    seed: int, skew_s: float | None, bias_px: float
) -> None:
    rng = np.random.default_rng(seed)
    before, found = pixels(rng), rng.random(COUNT) < (seed / 5)
    px = before + rng.normal(0, 3, (COUNT, 2)).astype(np.float32)
    # Some far ones have negative disparity, by a little or by more than noise explains.
    disparity = rng.uniform(-4, 30, COUNT)
    right = px - np.stack([disparity, rng.normal(0, 0.2, COUNT)], axis=1).astype(np.float32)
    points = (
        before,
        some(rng, np.maximum(disparity + rng.normal(0, 1, COUNT), 0.25)),
        some(rng, (disparity + rng.normal(0, 1, COUNT)).astype(np.float32)),
        px,
        some(rng, right.astype(np.float32)),
        rng.uniform(0.1, 0.5, (COUNT, 2)).astype(np.float32),
    )
    numbers = 0.001, bias_px, -2.0, 0.25
    skew = math.nan if skew_s is None else skew_s
    at = np.flatnonzero(found)
    results = seen_again(at, *points, CAMERA.numbers, 0.066, 2.5, skew, *numbers)
    expected = oracle.seen_again(found, *points, CAMERA, 0.066, 2.5, skew_s, *numbers)
    for result, other in zip(map(np.asarray, results), map(np.asarray, expected), strict=True):
        assert result.dtype == other.dtype
        np.testing.assert_allclose(result, other, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("seed", range(10))
def test_world_positions_of_points_match_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    px = pixels(rng)
    disparity = rng.uniform(0.25, 40, COUNT)
    place = POSE.apply(CAMERA.triangulate(px, disparity * rng.normal(1, 0.05, COUNT)))
    # Some are placed behind the camera, some at infinity, and some have no valid disparity.
    place[::7] = POSE.apply([[0.1, 0.2, -1.0]])
    place[::11] *= 1e200
    disparity[::13], disparity[1::13] = 0.0, -1.0
    arguments = (
        px,
        some(rng, disparity),
        rng.uniform(0.1, 0.5, (COUNT, 3)),
        some(rng, place, 0.1 * seed),
    )
    position, information = placed_in_world(
        *arguments, POSE.rotation, POSE.translation, CAMERA.numbers
    )
    others = oracle.placed_in_world(*arguments, POSE, CAMERA)
    np.testing.assert_allclose(position, others[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(information, others[1], rtol=1e-10, atol=1e-9)
    np.testing.assert_array_equal(information, information.transpose(0, 2, 1))


def test_no_points_give_empty_arrays() -> None:
    single, real = np.zeros((0, 2), np.float32), np.zeros((0, 3))
    position, information = placed_in_world(
        single, np.zeros(0), real, real, POSE.rotation, POSE.translation, CAMERA.numbers
    )
    assert position.shape == (0, 3)
    assert information.shape == (0, 3, 3)
