"""The verdict in metres: against a formula where there is one, and against the method itself."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from observer.calibration.fitting.fit import fit_stereo
from observer.calibration.fitting.stereo_fit import DepthBias, StereoFit
from observer.calibration.fitting.uncertainty import depth_change
from observer.calibration.report import depth_bias_of, fit_report
from observer.calibration.speed_limits import Thing, report_delay, slowest_reported
from observer.calibration.tape import tape_check
from observer.calibration.verdict import (
    TOWARDS,
    WITHIN_S,
    depth_bias_share,
    judge,
)
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import InputError
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.types import StereoFrame, TrackState

from .board_views import BOARD, HEIGHT, WIDTH, true_pair, views_of

LAB = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
RECTIFIED = StereoCalibration.rectified(640, 480, 500.0, 500.0, 319.5, 239.5, 0.1)
PARAMETERS = Parameters()


@pytest.fixture(scope="module")
def fit() -> StereoFit:
    return fit_stereo(views_of(true_pair(), 12, 0), BOARD, WIDTH, HEIGHT)


def test_depth_error_combines_noise_and_bias(fit: StereoFit) -> None:
    verdict = judge(fit, 30.0)
    assert [row.distance_m for row in verdict.rows] == [1.0, 3.0, 5.0]
    for row in verdict.rows:
        assert row.depth_m == pytest.approx(math.hypot(row.noise_m, row.bias_m))
        assert row.depth_share == pytest.approx(row.depth_m / row.distance_m)
    one, three, five = verdict.rows
    # Z^2 sigma_d / (f B): noise grows with the square of the depth.
    assert three.noise_m == pytest.approx(9 * one.noise_m)
    assert five.noise_m == pytest.approx(25 * one.noise_m)
    assert "At 3 m, depth is accurate to" in verdict.sentence
    assert verdict.warnings == ()


def test_depth_error_matches_the_verdict() -> None:
    """Over several calibrations from noisy views, at 3 m: the median is within two deviations."""
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


def test_vergence_error_grows_with_distance_but_scale_error_does_not() -> None:
    scale = DepthBias(((0.01**2, 0.0, 0.0, 0.0),))
    offset = DepthBias(((0.0, 0.0, 0.0, 0.2**2),))
    for distance in (1.0, 5.0):
        assert depth_bias_share(RECTIFIED, distance, scale) == pytest.approx(0.01)
        assert depth_bias_share(RECTIFIED, distance, offset) == pytest.approx(
            0.2 * distance / (500 * 0.1)
        )
    assert depth_bias_share(RECTIFIED, 2.0, None, 0.1) == pytest.approx(0.1 * 2 / 50)
    assert depth_bias_share(RECTIFIED, 2.0, None) == 0
    # Correlated errors may cancel: a share of 1 % against 0.5 px at 1 m.
    both = DepthBias(((1e-4, 5e-3, 5e-3, 0.25),))
    assert both.relative_sigma(0.02) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), TOWARDS])
def test_slower_farther_and_noisier_motion_is_reported_later(
    direction: tuple[float, float, float],
) -> None:
    def delay(speed: float = 0.3, depth: float = 3.0, sigma: float = 0.1) -> float:
        found = report_delay(
            LAB, depth, speed * np.array(direction), 15, 15.0, 4.0,
            Thing(sigma_px=sigma, disparity_px=1.5 * sigma), PARAMETERS,
        )  # fmt: skip
        return math.inf if found is None else found

    assert delay() < math.inf
    assert delay(speed=0.08) > delay()
    assert delay(depth=6.0) >= delay()
    assert delay(sigma=1.5) > delay()
    # Anything below the stopped threshold is never reported, however well it is seen.
    assert delay(speed=0.05, depth=1.0, sigma=0.05) == math.inf


def test_too_few_points_give_no_obstacle() -> None:
    velocity = np.array([0.5, 0.0, 0.0])
    assert report_delay(LAB, 3.0, velocity, 2, 15.0, 4.0, Thing(), PARAMETERS) is None
    assert report_delay(LAB, 3.0, velocity, 8, 15.0, 4.0, Thing(), PARAMETERS) is not None


def test_wider_baseline_or_larger_object_reveals_slower_approach() -> None:
    def slowest(camera: StereoCamera, thing: Thing) -> float:
        found = slowest_reported(camera, 3.0, TOWARDS, 15.0, WITHIN_S, thing, PARAMETERS)
        return math.inf if found is None else found.speed_mps

    small = Thing(width_m=0.4, height_m=0.4, followed_share=1.0)
    large = replace(small, height_m=1.7)
    narrow = replace(LAB, baseline=0.03)
    assert slowest(narrow, small) > slowest(replace(LAB, baseline=0.4), small)
    # Its image grows as it approaches, and more so the larger it is.
    assert slowest(narrow, small) > slowest(narrow, large)


def test_poor_rigs_get_warnings_with_advice(fit: StereoFit) -> None:
    narrow = StereoCalibration.rectified(640, 480, 500.0, 500.0, 319.5, 239.5, 0.005)
    verdict = judge(replace(fit, calibration=narrow), 30.0)
    assert any(
        "5 mm is too short" in w and "would reduce it to ± 4 %" in w for w in verdict.warnings
    )
    poor = replace(fit, rms_stereo=1.2, coverage=(0.9, 0.3), pairs=6, held_out=None)
    words = " ".join(judge(poor, 30.0).warnings)
    for part in ("1.2 px is high", "30 % of the right image", "6 pairs are too few"):
        assert part in words
    sure = replace(fit, held_out=replace(fit.held_out, p95_px=1.5))
    assert "reaches 1.5 px" in " ".join(judge(sure, 30.0).warnings)


def test_objects_too_near_to_match_are_reported(fit: StereoFit) -> None:
    sharp = StereoCalibration.rectified(1920, 1080, 1400.0, 1400.0, 959.5, 539.5, 0.12)
    verdict = judge(replace(fit, calibration=sharp), 30.0)
    assert verdict.nearest_m == pytest.approx(1400 * 0.12 / 96)
    assert verdict.rows[0].across is verdict.rows[0].towards is None
    assert verdict.rows[1].across is not None
    assert any("nearer than 1.8 m" in w and "to 224" in w for w in verdict.warnings)
    assert judge(replace(fit, calibration=RECTIFIED), 30.0).nearest_m == pytest.approx(50 / 96)


SCENE = """
based_on: _benchmark
duration_s: 3.2
camera: {height_m: 0.6, tilt_deg: 0}
observer: {motion: null}
texture: {share_without: 0.3, robot: red}
variation: {position_m: 0, heading_deg: 0, speed: 0}
robots:
  - x: 3.3
    y: %s
    heading_deg: %s
    size: [0.5, 0.5, 0.9]
    motion:
      kind: course
      acceleration: 20
      legs: [{kind: wait, seconds: 2}, {kind: drive, distance_m: 1, speed: %s}]
"""


@pytest.mark.slow
@pytest.mark.parametrize(("y", "heading", "speed"), [(0.3, -90, 0.2), (0.0, 180, 0.3)])
def test_measured_report_delay_matches_the_verdict(
    tmp_path: Path, y: float, heading: float, speed: float
) -> None:
    """A body starts to move 3 m away, across or towards the simulated cameras."""
    (tmp_path / "scene.yaml").write_text(SCENE % (y, heading, speed))
    source = open_source(f"simulated:{tmp_path}/scene.yaml").source
    assert source.calibration is not None
    observer = Observer(source.calibration, PARAMETERS)
    reported = None
    while reported is None and isinstance(frame := source.read(), StereoFrame):
        seen = [o for o in observer.observe(frame).obstacles if o.state is TrackState.CONFIRMED]
        reported = frame.time - 2 if seen and frame.time > 2 else None
    source.close()
    direction = (1.0, 0.0, 0.0) if heading == -90 else TOWARDS
    thing = Thing(width_m=0.5, height_m=0.9)
    predicted = report_delay(
        LAB, 3.0, speed * np.array(direction), 20, 15.0, 3.0, thing, PARAMETERS
    )
    assert reported == pytest.approx(predicted, abs=0.35)


def test_unrectifiable_calibration_is_judged_with_a_warning(
    fit: StereoFit,
) -> None:
    folded = replace(true_pair(), D1=np.array([-0.5, -3.0, 0, 0, 0]))
    verdict = judge(replace(fit, calibration=folded), 15.0)
    assert any("cannot be rectified" in warning for warning in verdict.warnings)


def test_report_is_plain_json_and_retains_tape_check_inputs(fit: StereoFit) -> None:
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


def test_print_at_97_percent_shows_as_excessive_depth() -> None:
    # Squares are 24.25 mm but 25 mm was entered: the rig measures all distances too large.
    check = tape_check(RECTIFIED, 3.0 / 0.97, 3.0, square_m=0.025)
    assert not check.agrees
    assert check.share == pytest.approx(1 / 0.97 - 1)
    assert check.square_m == pytest.approx(0.02425)
    assert check.baseline_m == pytest.approx(0.097)
    assert "squares of 24.2 mm instead of 25 mm" in check.sentence
    assert "too far" in check.sentence


def test_turned_camera_can_also_explain_a_tape_check() -> None:
    turn = math.radians(0.1)
    # Disparity 500 * 0.1 / 3 px, minus the part due to the turn.
    measured = 50 / (50 / 3 - 500 * turn)
    check = tape_check(RECTIFIED, measured, 3.0)
    assert check.vergence_deg == pytest.approx(0.1)
    assert check.square_m is None
    assert "0.10 degrees" in check.sentence


def test_tape_check_agrees_within_its_interval() -> None:
    sure = tape_check(RECTIFIED, 3.04, 3.0)
    unsure = tape_check(RECTIFIED, 3.04, 3.0, bias=DepthBias(((0.02**2, 0, 0, 0),)))
    assert unsure.expected_m > sure.expected_m > 0.02
    assert unsure.agrees
    assert "within the" in unsure.sentence
    assert not tape_check(RECTIFIED, 3.4, 3.0, bias=DepthBias(((0.02**2, 0, 0, 0),))).agrees


@pytest.mark.parametrize(("rig", "tape"), [(math.nan, 3.0), (3.0, 0.0), (3.0, 1e4), (-1.0, 3.0)])
def test_tape_check_requires_valid_distances(rig: float, tape: float) -> None:
    with pytest.raises(InputError, match="distances from"):
        tape_check(RECTIFIED, rig, tape)
