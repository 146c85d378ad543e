"""The kernels for single places in a camera's view against the same by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.kernels.sight import place_of, sighting, view_of

from .oracles import sight as oracle

CAMERA = StereoCamera(512, 256, 300.0, 301.0, 255.0, 127.0, 0.12)


def somewhere(seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    return Pose.from_rotvec(rng.normal(0.0, 0.5, 3), rng.normal(0.0, 2.0, 3))


@pytest.mark.parametrize("seed", range(10))
def test_placed_sightings_match_numpy(seed: int) -> None:
    rng, pose = np.random.default_rng(seed), somewhere(seed)
    u, v, disparity = rng.uniform([-50.0, -50.0, 0.5], [560.0, 300.0, 60.0]).tolist()
    across, down, along = rng.uniform(0.01, 30.0, 3).tolist()
    view = (pose.rotation, pose.translation, CAMERA.numbers)
    place, cov = sighting(u, v, disparity, across, down, along, *view)
    wanted, wanted_cov = oracle.sighting(
        np.array([u, v]), disparity, np.array([across, down, along]), pose, CAMERA
    )
    np.testing.assert_allclose(place, wanted, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(cov, wanted_cov, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(place_of(u, v, disparity, *view), place)


@pytest.mark.parametrize("disparity", [0.0, -1.0, np.nan])
def test_no_position_is_given_without_a_disparity(disparity: float) -> None:
    pose = somewhere(0)
    assert np.isnan(
        place_of(10.0, 10.0, disparity, pose.rotation, pose.translation, CAMERA.numbers)
    ).all()


@pytest.mark.parametrize("seed", range(10))
def test_projected_positions_match_numpy(seed: int) -> None:
    place, pose = np.random.default_rng(seed).normal(0.0, 3.0, 3), somewhere(seed)
    px, disparity = CAMERA.project(pose.apply(place))
    found = view_of(place, pose.rotation, pose.translation, CAMERA.numbers)
    np.testing.assert_allclose(found, [*px, disparity], rtol=1e-11)
