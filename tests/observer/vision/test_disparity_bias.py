"""Disparity bias from near versus far points: views of known places with a known bias."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.vision.disparity_bias import DisparityBias, bias_profile
from observer.vision.vergence_fit import SeenTwice
from observer.vision.view import StereoRows

CAMERA = StereoCamera(640, 480, 500.0, 500.0, 319.5, 239.5, 0.12)


def driven(bias_px: float, *, seed: int = 0, far_only: bool = False) -> DisparityBias:
    """Estimate over 20 pairs of views, 0.1 m apart, of 200 points; disparities lack ``bias_px``."""
    rng = np.random.default_rng(seed)
    bias = DisparityBias()
    for _ in range(20):
        depth = np.full(200, 6.0) if far_only else rng.uniform(1.5, 8.0, 200)
        ray = rng.uniform([-0.55, -0.4, 1.0], [0.55, 0.4, 1.0], (200, 3))
        before = Pose.identity()
        after = Pose.from_rotvec(np.array([0.0, 0.01, 0.0]), np.array([0.0, 0.0, -0.1]))
        views = [_seen(pose.apply(ray * depth[:, None]), bias_px, rng) for pose in (before, after)]
        bias = bias.with_pair(SeenTwice.of(views[0], views[1], after), CAMERA, 0.0)
    return bias


def _seen(place: np.ndarray, bias_px: float, rng: np.random.Generator) -> StereoRows:
    px, disparity = CAMERA.project(place)
    seen = disparity - bias_px * bias_profile(px, disparity, CAMERA) + rng.normal(0, 0.1, len(px))
    px = px + rng.normal(0, 0.1, px.shape)
    return StereoRows(px, np.zeros(len(px)), seen, np.arange(len(px)))


@pytest.mark.parametrize("true_px", [-0.5, 0.0, 0.6])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_driving_past_near_and_far_points_determines_the_bias(true_px: float, seed: int) -> None:
    bias = driven(true_px, seed=seed)
    assert abs(bias.px - true_px) < 2 * bias.sigma_px
    assert bias.known
    assert bias.sure == (true_px != 0)


def test_bias_is_unknown_without_pairs() -> None:
    assert DisparityBias().px == 0
    assert math.isinf(DisparityBias().sigma_px)
    assert not DisparityBias().sure


def test_distant_points_alone_determine_the_bias_less_well() -> None:
    assert driven(0.5, far_only=True).sigma_px > 1.5 * driven(0.5).sigma_px


def test_shared_uncertainty_reduces_the_information_of_pairs() -> None:
    rng = np.random.default_rng(3)
    place = rng.uniform([-2.0, -1.0, 2.0], [2.0, 1.0, 8.0], (200, 3))
    after = Pose.from_rotvec(np.zeros(3), np.array([0.0, 0.0, -0.1]))
    seen = SeenTwice.of(_seen(place, 0.3, rng), _seen(after.apply(place), 0.3, rng), after)
    sure, doubtful = (DisparityBias().with_pair(seen, CAMERA, px) for px in (0.0, 1.0))
    assert doubtful.information < 1.0 < sure.information
    assert doubtful.px == pytest.approx(sure.px)
