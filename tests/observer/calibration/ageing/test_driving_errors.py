"""Vergence and skew from the method's own estimates, compared with the wheels."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from observer.calibration.ageing.driving_errors import (
    PointsVergence,
    SkewWatch,
    joined_vergence,
    vergence_by_points,
)
from observer.calibration.ageing.vergence import VergenceCheck
from observer.camera import StereoCamera
from observer.vision.disparity_bias import DisparityBias
from observer.vision.exposure_skew import ExposureSkew

CAMERA = StereoCamera(640, 480, 500.0, 500.0, 319.5, 239.5, 0.12)


def known(px: float, pairs: float = 20.0) -> DisparityBias:
    """A bias known to about 0.06 px from 20 agreeing pairs."""
    information = 4.0 / 0.03**2
    return DisparityBias(information, information * px, information * px**2, pairs)


def by_wheels(
    status: Literal["unobserved", "consistent", "drifted"],
    deg: float | None,
    std_deg: float | None,
) -> VergenceCheck:
    vergence, std = (None if angle is None else math.radians(angle) for angle in (deg, std_deg))
    return VergenceCheck(status, vergence, std, "as the wheels tell", 3.0)


@pytest.mark.parametrize("px", [0.6, -0.6])
def test_bias_is_reported_as_vergence_of_the_same_sign(px: float) -> None:
    check = vergence_by_points(known(px), CAMERA)
    assert check.status == "drifted"
    assert check.vergence_rad == pytest.approx(px / 500.0)
    assert check.std_rad == pytest.approx(known(px).sigma_px / 500.0)
    # 0.6 px of the 20 px disparity at 3 m; too small a disparity appears too far.
    course, error = ("more", "far") if px > 0 else ("less", "near")
    assert f"converge {course} than calibrated, by 0.07° ± 0.0" in check.sentence
    assert f"points at 3 m appear about 3 % too {error}" in check.sentence
    assert "compensated for the rest of the run" in check.sentence


def test_well_known_negligible_bias_is_consistent() -> None:
    check = vergence_by_points(known(0.02), CAMERA)
    assert check.status == "consistent"
    assert "near and far points confirm the calibrated vergence" in check.sentence


def test_finding_persists_until_the_estimate_restarts() -> None:
    watch = PointsVergence(CAMERA)
    assert watch.update(None) is None
    assert watch.update(DisparityBias(1.0, 0.5, 0.25, 1.0)) is None
    found = watch.update(known(0.6))
    assert found is not None
    assert watch.update(None) is found
    assert watch.update(DisparityBias(1.0, 0.5, 0.25, 1.0)) is found
    assert watch.update(DisparityBias()) is None


def test_near_far_estimate_wins_unless_the_wheels_are_more_certain() -> None:
    points = vergence_by_points(known(0.6), CAMERA)
    assert joined_vergence(by_wheels("unobserved", None, None), points) is points
    assert joined_vergence(by_wheels("unobserved", 0.05, 0.03), points) is points
    assert joined_vergence(by_wheels("drifted", 0.08, 0.015), points) is points
    better = by_wheels("drifted", 0.07, 0.001)
    assert joined_vergence(better, points) is better
    assert joined_vergence(better, None) is better


def test_contradiction_is_reported() -> None:
    points = vergence_by_points(known(0.6), CAMERA)
    # 0.069 deg against -0.05 deg, known to 0.007 and 0.02.
    joined = joined_vergence(by_wheels("consistent", -0.05, 0.02), points)
    assert (joined.status, joined.vergence_rad) == ("drifted", points.vergence_rad)
    assert joined.sentence.startswith(points.sentence)
    assert "the wheels contradict this: −0.05° ± 0.04°" in joined.sentence
    joined = joined_vergence(by_wheels("drifted", -0.05, 0.001), points)
    assert "near and far points contradict this: +0.07°" in joined.sentence


def estimated(skew_s: float, sigma_s: float) -> ExposureSkew:
    """Return an estimate without a residual: the disparities fit the skew exactly."""
    flow = np.array([1 / sigma_s, 0.0])
    seen = np.stack([-skew_s * flow, flow, [0.0, 1.0]])
    return ExposureSkew(frames=2.0, sums=seen @ seen.T)


@pytest.mark.parametrize(("skew_s", "course"), [(0.0162, "after"), (-0.0162, "before")])
def test_confident_skew_is_reported_and_updated_only_when_its_text_changes(
    skew_s: float, course: str
) -> None:
    watch = SkewWatch()
    assert watch.update(None) is None
    assert watch.update(estimated(skew_s, 1.0)) is None
    found = watch.update(estimated(skew_s, 0.0004))
    assert found is not None
    assert found.exposure_skew_s == pytest.approx(skew_s)
    assert found.sigma_s == pytest.approx(0.0004)
    assert f"exposes 16.2 ± 0.8 ms {course} the left one" in found.sentence
    assert watch.update(estimated(1.0001 * skew_s, 0.0004)) is found
    assert watch.update(None) is found
    assert watch.update(estimated(1.1 * skew_s, 0.0004)) is not found
