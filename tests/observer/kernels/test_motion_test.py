"""The kernels of the motion test against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters
from observer.vision.camera_rate import CameraRate

from .oracles import lasting_errors as lasting_oracle
from .oracles import motion_test as oracle

CAMERA = StereoCamera(512, 256, 300.0, 301.0, 255.0, 127.0, 0.12)
DT = 1 / 15


def step(seed: int) -> CameraStep:
    rng = np.random.default_rng(seed)
    pose = Pose.from_rotvec(rng.normal(0, 0.3, 3), rng.normal(0, 0.5, 3))
    spread = rng.normal(0, 1e-3, (6, 6))
    rate = CameraRate(rng.normal(0, 0.2, 3), rng.normal(0, 0.4, 3))
    return CameraStep(CAMERA, pose, spread @ spread.T, rate, DT)


def tracked(seed: int, now: CameraStep, count: int = 250) -> TrackedPoints:
    """Points seen one to twelve times; some lie behind others, some have no disparity."""
    rng = np.random.default_rng(seed)
    place = now.T_world_camera.apply(rng.uniform([-2, -0.8, 1], [2, 0.8, 6], (count, 3)))
    velocity = np.where(rng.random(count) < 0.4, 0.5, 0.0)[:, None] * rng.normal(0, 1, 3)
    sightings = rng.integers(1, 13, count)
    sums = None
    for k in range(12):
        at = place + velocity * (k - 11) * DT + rng.normal(0, 0.01, (count, 3))
        spread = rng.normal(0, 30, (count, 3, 3))
        information = spread @ spread.transpose(0, 2, 1) * (k >= 12 - sightings)[:, None, None]
        if sums is None:
            sums = PositionVelocityFilter.begin(at, information)
        else:
            sums = sums.advanced(DT, 0.6).with_sightings(at, information)
    px, disparity = CAMERA.project(now.T_camera_world.apply(place))
    single = px.astype(np.float32)
    points = TrackedPoints.begin(0, single, single, disparity, sums)
    cornered, recurs = rng.random((2, count)) < [[0.9], [0.1]]
    return points.but(sightings=sightings, cornered=cornered, recurs=recurs)


@pytest.mark.parametrize("seed", range(12))
def test_own_and_pooled_motion_match_numpy(seed: int) -> None:
    now = step(seed)
    points = tracked(seed, now)
    parameters = EvidenceParameters()
    with np.errstate(all="ignore"):
        own = oracle.own_motion(points, parameters)
        pairs = oracle.neighbours(points.px, own, now, parameters)
        velocity, cov, neighbours = oracle.pooled(own, pairs, parameters)
        shared = oracle.shared_covariance(own.position, points.sums.window_s(), now, parameters)
        significance = oracle.significance(velocity, cov + shared, own.ready)
    found = pooled_motion(points, now, parameters)
    assert 20 < own.ready.sum() < len(points)
    assert len(pairs) >= 20
    np.testing.assert_array_equal(found.judged, own.ready)
    for name, kernel, numpy in (
        ("own velocity", found.own_velocity, own.velocity),
        ("own information", found.own_information, own.information),
        ("position", found.position, own.position),
        ("covariance of the position", found.position_cov, own.position_cov),
        ("window", found.window_s, points.sums.window_s()),
        ("velocity", found.velocity[own.ready], velocity[own.ready]),
        ("covariance", found.covariance[own.ready], (cov + shared)[own.ready]),
        ("shared covariance", found.shared_cov, shared),
        ("significance", found.significance, significance),
    ):
        np.testing.assert_allclose(
            kernel, numpy, rtol=1e-7, atol=1e-9, equal_nan=True, err_msg=name
        )
    assert {tuple(p) for p in found.pairs.tolist()} == {tuple(sorted(p)) for p in pairs.tolist()}
    np.testing.assert_array_equal(found.neighbours[own.ready], neighbours[own.ready])


def test_all_pairs_are_found_when_there_are_more_than_expected() -> None:
    now = step(0)
    points = tracked(1, now, count=600)
    crowd = np.full((600, 2), 100, np.float32) + np.arange(600, dtype=np.float32)[:, None] * 0.01
    points = points.but(px=crowd)
    parameters = EvidenceParameters(radius_px=60)
    found = pooled_motion(points, now, parameters)
    pairs = oracle.neighbours(points.px, oracle.own_motion(points, parameters), now, parameters)
    assert len(pairs) > 16 * 600 + 16
    assert len(found.pairs) == len(pairs)


@pytest.mark.parametrize("seed", range(6))
def test_lasting_errors_match_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    now = step(seed)
    # A third of the points lie behind the camera, where nothing is seen.
    place, velocity = rng.uniform(-2, 4, (40, 3)), rng.normal(0, 1, (40, 3))
    bias, stretch = now.rate.lasting_errors(place, velocity, CAMERA, 0.3, 0.02).swapaxes(0, 1)
    expected = lasting_oracle.velocity_by_bias(now.rate, place, velocity, CAMERA)
    np.testing.assert_allclose(bias, 0.3 * expected, atol=1e-12)
    expected = lasting_oracle.velocity_by_distortion(now.rate, place, velocity, CAMERA)
    np.testing.assert_allclose(stretch, 0.02 * expected, atol=1e-12)
