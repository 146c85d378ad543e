"""The verdict in metres: by formula where there is one, and against the method itself."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from observer.calibration.fit import fit_stereo
from observer.calibration.report import depth_bias_of, fit_report
from observer.calibration.speed_limits import Thing, report_delay, slowest_reported
from observer.calibration.stereo_fit import DepthBias, StereoFit
from observer.calibration.tape import tape_check
from observer.calibration.uncertainty import depth_change
from observer.calibration.verdict import (
    TOWARDS,
    WITHIN_S,
    depth_bias_share,
    judge,
    judge_calibration,
)
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import InputError
from observer.parameters import Parameters

from .board_views import BOARD, HEIGHT, WIDTH, true_pair, views_of

LAB = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
RECTIFIED = StereoCalibration.rectified(640, 480, 500.0, 500.0, 319.5, 239.5, 0.1)
PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def fit() -> StereoFit:
    return fit_stereo(views_of(true_pair(), 12, 0), BOARD, WIDTH, HEIGHT)


def test_depth_error_is_noise_and_lasting_error(fit: StereoFit) -> None:
    verdict = judge(fit, 30.0)
    assert [row.distance_m for row in verdict.rows] == [1.0, 3.0, 5.0]
    for row in verdict.rows:
        assert row.depth_m == pytest.approx(math.hypot(row.noise_m, row.bias_m))
        assert row.depth_share == pytest.approx(row.depth_m / row.distance_m)
    one, three, five = verdict.rows
    # Z^2 sigma_d / (f B): noise grows with the square.
    assert three.noise_m == pytest.approx(9 * one.noise_m)
    assert five.noise_m == pytest.approx(25 * one.noise_m)
    assert "At 3 m depth is right to" in verdict.sentence
    assert verdict.warnings == ()


def test_depth_is_as_wrong_as_the_verdict_says() -> None:
    """Over several calibrations by noisy views, at 3 m: the middle one within two deviations."""
    true, shares = true_pair(), []
    for seed in range(3):
        fit = fit_stereo(views_of(true, 7, 40 + seed), BOARD, WIDTH, HEIGHT)
        found = fit.calibration
        per_disparity = 3 / (true.K1[0, 0] * true.baseline)
        scale, offset = depth_change(true, found).mean(axis=0)
        lasting = fit.held_out.lasting_px if fit.held_out else 0.0
        sigma = depth_bias_share(found, 3.0, fit.depth_bias, lasting)
        shares.append(abs(scale - offset * per_disparity) / sigma)
    assert np.median(shares) < 2
    assert max(shares) > 0.05


def test_vergence_counts_with_distance_and_scale_does_not() -> None:
    scale = DepthBias(((0.01**2, 0.0, 0.0, 0.0),))
    offset = DepthBias(((0.0, 0.0, 0.0, 0.2**2),))
    for distance in (1.0, 5.0):
        assert depth_bias_share(RECTIFIED, distance, scale) == pytest.approx(0.01)
        assert depth_bias_share(RECTIFIED, distance, offset) == pytest.approx(
            0.2 * distance / (500 * 0.1)
        )
    assert depth_bias_share(RECTIFIED, 2.0, None, 0.1) == pytest.approx(0.1 * 2 / 50)
    assert depth_bias_share(RECTIFIED, 2.0, None) == 0
    # Where they err together they may cancel: a share of 1 % against 0.5 px at 1 m.
    both = DepthBias(((1e-4, 5e-3, 5e-3, 0.25),))
    assert both.relative_sigma(0.02) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), TOWARDS])
def test_slower_farther_and_noisier_is_reported_later(
    direction: tuple[float, float, float],
) -> None:
    def delay(speed: float = 0.3, depth: float = 3.0, sigma: float = 0.1) -> float:
        found = report_delay(
            LAB, depth, speed * np.array(direction), 15, 15.0, 4.0, sigma, PARAMETERS
        )
        return math.inf if found is None else found

    assert delay() < math.inf
    assert delay(speed=0.08) > delay()
    assert delay(depth=6.0) >= delay()
    assert delay(sigma=1.5) > delay()
    # Slower than what counts as stopped is never reported, however well it is seen.
    assert delay(speed=0.05, depth=1.0, sigma=0.05) == math.inf


def test_too_few_points_are_no_obstacle() -> None:
    velocity = np.array([0.5, 0.0, 0.0])
    assert report_delay(LAB, 3.0, velocity, 2, 15.0, 4.0, 0.1, PARAMETERS) is None
    assert report_delay(LAB, 3.0, velocity, 8, 15.0, 4.0, 0.1, PARAMETERS) is not None


def test_a_wider_baseline_sees_slower_approach() -> None:
    near = slowest_reported(LAB, 5.0, TOWARDS, 15.0, WITHIN_S, Thing(), PARAMETERS)
    wide = slowest_reported(
        replace(LAB, baseline=0.4), 5.0, TOWARDS, 15.0, WITHIN_S, Thing(), PARAMETERS
    )
    assert wide is not None
    assert near is None or near.speed_mps > wide.speed_mps


def test_poor_rigs_are_told_so_with_what_to_do(fit: StereoFit) -> None:
    narrow = StereoCalibration.rectified(640, 480, 500.0, 500.0, 319.5, 239.5, 0.005)
    verdict = judge_calibration(narrow, 30.0)
    assert any("5 mm apart" in w and "would make it 2 %" in w for w in verdict.warnings)
    assert any("was not measured here" in w for w in verdict.warnings)
    poor = replace(fit, rms_stereo=1.2, coverage=(0.9, 0.3), pairs=6, held_out=None)
    words = " ".join(judge(poor, 30.0).warnings)
    for part in ("1.2 px only", "30 % of the right image", "with 6 pairs"):
        assert part in words
    sure = replace(fit, held_out=replace(fit.held_out, p95_px=1.5))
    assert "rows disagree by up to 1.5 px" in " ".join(judge(sure, 30.0).warnings)


def test_a_calibration_that_cannot_be_rectified_is_judged_with_a_warning() -> None:
    folded = replace(true_pair(), D1=np.array([-0.5, -3.0, 0, 0, 0]))
    verdict = judge_calibration(folded, 15.0)
    assert any("cannot be rectified" in warning for warning in verdict.warnings)


def test_report_is_plain_and_gives_back_what_a_tape_check_needs(fit: StereoFit) -> None:
    report = json.loads(json.dumps(fit_report(fit, judge(fit, 30.0)), allow_nan=False))
    assert report["rms_stereo_px"] == fit.rms_stereo
    assert report["board"]["words"] == "chessboard 9x6, 25 mm"
    assert [view["name"] for view in report["views"]] == [view.name for view in fit.views]
    assert report["verdict"]["rows"][1]["distance_m"] == 3.0
    bias, lasting = depth_bias_of(report)
    assert bias == fit.depth_bias
    assert lasting == fit.held_out.lasting_px
    odd = replace(fit, rms_left=math.nan, held_out=None)
    plain = fit_report(odd)
    assert (plain["rms_left_px"], plain["held_out"], plain["verdict"]) == (None, None, None)
    assert depth_bias_of({}) == (None, 0.0)


def test_a_print_at_97_percent_shows_as_depth_that_is_too_large() -> None:
    # Squares are 24.25 mm, 25 mm was typed in: all that the rig measures is too far.
    check = tape_check(RECTIFIED, 3.0 / 0.97, 3.0, square_m=0.025)
    assert not check.agrees
    assert check.share == pytest.approx(1 / 0.97 - 1)
    assert check.square_m == pytest.approx(0.02425)
    assert check.baseline_m == pytest.approx(0.097)
    assert "squares of 24.2 mm instead of 25 mm" in check.sentence
    assert "too far" in check.sentence


def test_a_turned_camera_explains_a_tape_check_as_well() -> None:
    turn = math.radians(0.1)
    # Disparity 500 * 0.1 / 3 px, less what the turn adds to it.
    measured = 50 / (50 / 3 - 500 * turn)
    check = tape_check(RECTIFIED, measured, 3.0)
    assert check.vergence_deg == pytest.approx(0.1)
    assert check.square_m is None
    assert "0.10 degrees" in check.sentence


def test_a_tape_check_agrees_within_two_deviations() -> None:
    sure = tape_check(RECTIFIED, 3.04, 3.0)
    unsure = tape_check(RECTIFIED, 3.04, 3.0, bias=DepthBias(((0.02**2, 0, 0, 0),)))
    assert unsure.expected_m > sure.expected_m > 0.02
    assert unsure.agrees
    assert "within the" in unsure.sentence
    assert not tape_check(RECTIFIED, 3.4, 3.0, bias=DepthBias(((0.02**2, 0, 0, 0),))).agrees


@pytest.mark.parametrize(("rig", "tape"), [(math.nan, 3.0), (3.0, 0.0), (3.0, 1e4), (-1.0, 3.0)])
def test_a_tape_check_wants_distances(rig: float, tape: float) -> None:
    with pytest.raises(InputError, match="distances of"):
        tape_check(RECTIFIED, rig, tape)
