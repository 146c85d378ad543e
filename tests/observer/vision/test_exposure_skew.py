"""Exposure skew from static points: a camera that turns unevenly, with a known skew."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.vision.exposure_skew import DisparityStep, ExposureSkew

CAMERA = StereoCamera(640, 480, 500.0, 500.0, 319.5, 239.5, 0.12)
DT = 1 / 15


def turned(
    skew_s: float, *, rate: float = 0.35, steady: bool = False, seed: int = 0
) -> ExposureSkew:
    """Estimate over 3 s from a camera that turns to and fro, or steadily, at up to 0.35 rad/s."""
    rate = 0.35
    rng = np.random.default_rng(seed)
    place = rng.uniform([-3.0, -1.2, 2.0], [3.0, 1.2, 8.0], (250, 3))

    def angle(t: float) -> float:
        return rate * t if steady else -rate * math.cos(math.pi * t) / math.pi

    def seen(t: float) -> tuple[np.ndarray, np.ndarray]:
        left, right = (
            Pose.from_rotvec(np.array([0.0, angle(time), 0.0]), np.array([0, 0, -0.2 * time]))
            for time in (t, t + skew_s)
        )
        px, _ = CAMERA.project(left.apply(place))
        in_right, _ = CAMERA.project(right.apply(place) - [CAMERA.baseline, 0.0, 0.0])
        disparity = px[:, 0] - in_right[:, 0]
        return px + rng.normal(0, 0.1, px.shape), disparity + rng.normal(0, 0.1, len(px))

    skew, (px, disparity) = ExposureSkew(), seen(0.0)
    for frame in range(1, 45):
        now_px, now_disparity = seen(frame * DT)
        step = DisparityStep.of(px, now_px, disparity, now_disparity, DT, CAMERA)
        skew = skew.after(step)
        px, disparity = now_px, now_disparity
    return skew


@pytest.mark.parametrize("true_s", [-0.010, 0.0, 0.016])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_uneven_turning_determines_the_skew(true_s: float, seed: int) -> None:
    skew = turned(true_s, seed=seed)
    assert abs(skew.skew_s - true_s) < 3 * skew.sigma_s
    assert skew.sigma_s < 0.002
    assert skew.sure == (true_s != 0)


def test_steady_turn_leaves_the_skew_uncertain() -> None:
    skew = turned(0.016, steady=True)
    assert skew.sigma_s > 0.002
    assert not skew.sure


def estimated(true_s: float, left_over: np.ndarray, rng: np.random.Generator) -> ExposureSkew:
    """Estimate from 90 frames of a camera that turns unevenly, with given errors (90,) px of c."""
    flow = 100 * np.sin(np.cumsum(rng.uniform(0, 0.4, 92)))
    skew = ExposureSkew()
    for k in range(1, 91):
        # The flow at a frame is the mean of that before and after it.
        change = (flow[k + 1] - flow[k - 1]) / 2
        c = -true_s * change + left_over[k - 1]
        skew = skew.after(DisparityStep(DT, float(c), 0.04, float(flow[k])))
    return skew


@pytest.mark.parametrize("seed", range(8))
def test_lasting_errors_and_a_constant_are_no_skew(seed: int) -> None:
    """What moves unnoticed, and the camera's motion, leave errors that last over frames."""
    rng = np.random.default_rng(seed)
    lasting = np.zeros(90)
    for k in range(1, 90):
        lasting[k] = 0.8 * lasting[k - 1] + rng.normal(0, 0.06)
    skew = estimated(0.0, lasting + rng.choice([-0.1, 0.1]), rng)
    assert not skew.sure
    assert abs(skew.skew_s) < 3 * skew.sigma_s


@pytest.mark.parametrize("seed", range(4))
def test_the_stated_uncertainty_grows_with_what_is_left_over(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quiet = estimated(0.01, rng.normal(0, 0.04, 90), np.random.default_rng(seed))
    noisy = estimated(0.01, rng.normal(0, 0.16, 90), np.random.default_rng(seed))
    assert noisy.sigma_s == pytest.approx(4 * quiet.sigma_s, rel=0.5)
    assert quiet.skew_s == pytest.approx(0.01, abs=3 * quiet.sigma_s)
    assert quiet.sure


def test_non_consecutive_frames_are_not_compared() -> None:
    step = DisparityStep(DT, 1.0, 0.05, 10.0)
    other = DisparityStep(DT, 1.0, 0.05, 90.0)
    known = ExposureSkew().after(step).after(step)
    assert known.after(other).frames > 0
    assert known.interrupted().after(other).frames == 0
    assert known.after(None).after(other).frames == 0


def test_too_few_points_give_no_step() -> None:
    few = np.zeros((5, 2))
    assert DisparityStep.of(few, few, np.ones(5), np.ones(5), DT, CAMERA) is None
    assert math.isinf(ExposureSkew().sigma_s)
