"""The kernels for a rigid body's pose against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.body_pose import fit_body, place_members
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.measurement import Members

from .matrices import positive
from .oracles import body_pose as oracle


@pytest.mark.parametrize("count", [0, 1, 25])
@pytest.mark.parametrize("seed", range(5))
def test_placed_members_match_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    information = positive(rng, count, 50.0) * (rng.random(count) < 0.7)[:, None, None]
    arguments = (
        information, rng.normal(0.0, 100.0, (count, 3)), positive(rng, count, 30.0),
        yaw_matrix(float(rng.uniform(-3, 3))),
    )  # fmt: skip
    place, cov, known, noise = place_members(*arguments)
    wanted = oracle.place_members(*arguments)
    np.testing.assert_allclose(place, wanted[0], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(cov, wanted[1], rtol=1e-8, atol=1e-9)
    np.testing.assert_array_equal(known, wanted[2])
    np.testing.assert_allclose(noise, wanted[3], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("off", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("count", [1, 3, 4, 40])
@pytest.mark.parametrize("seed", range(8))
def test_the_pose_matches_numpy(seed: int, count: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    truth = np.array([0.4, 0.1, 3.0, rng.uniform(-3, 3)])
    place = rng.uniform(-0.4, 0.4, (count, 3))
    sighting = truth[:3] + place @ yaw_matrix(truth[3]).T + rng.normal(0.0, 0.01, (count, 3))
    # Some do not belong to it, and some have no known place; the first one has.
    sighting += np.where(rng.random(count) < 0.2, 0.5, 0.0)[:, None]
    known = rng.random(count) < 0.8
    known[0] = True
    members = Members(
        place, positive(rng, count, 0.005), known, sighting, positive(rng, count, 0.01)
    )
    expected = truth + off * rng.normal(0.0, 1.0, 4)
    factor = rng.normal(0.0, 0.1, (4, 4))
    spread = factor @ factor.T + 1e-4 * np.eye(4)
    ego_noise = positive(rng, 1, 0.003)[0]
    pose, cov, misfits = fit_body(
        members.place, members.place_cov, members.known, members.sighting, members.noise,
        expected, spread, ego_noise, 0.1,
    )  # fmt: skip
    wanted = oracle.fit_body(members, expected, spread, ego_noise, 0.1)
    np.testing.assert_allclose(pose, wanted[0], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(cov, wanted[1], rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(misfits, wanted[2])
