"""Accuracy of calibrations: planted camera errors are measured exactly."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from observer.camera import StereoCalibration
from observer.evaluation.calibration_accuracy import (
    BOARD_SCENARIO,
    DEPTH_SCENARIO,
    CalibrationAccuracy,
    CameraErrors,
    DepthAccuracy,
    Scene,
    calibration_accuracy,
    calibration_targets,
    camera_errors,
    depth_accuracy,
    exact_row_error_p95,
    same_cameras,
    scenes_of,
)
from observer.evaluation.calibration_report import calibration_markdown
from observer.simulation.rig import small_rotation
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World


@cache
def place() -> World:
    return World(load_scenario(DEPTH_SCENARIO), 0)


@cache
def scenes() -> list[Scene]:
    return scenes_of(place(), 1)


@cache
def truth() -> StereoCalibration:
    return place().true_calibration


def figures(focal: float = 0.1, held_out: float | None = 0.1, seed: int = 1) -> CalibrationAccuracy:
    errors = CameraErrors(focal, 0.1, 0.01, 0.01, 0.001, 0.001, 0.001)
    depth = DepthAccuracy(100, 0.9, 1.0, -0.5, 1.5)
    return CalibrationAccuracy(
        seed, 20, 19, 0, errors, 0.06, held_out, 0.02, depth, depth, 1.0, 2.0
    )


def test_camera_errors_match_the_planted_ones() -> None:
    K2 = truth().K2.copy()
    K2[1, 1] *= 0.996
    turned = replace(
        truth(), K2=K2, T=1.01 * truth().T, R=small_rotation(0.0, 0.03, 0.04) @ truth().R
    )
    errors = camera_errors(turned, truth())
    assert errors.focal_percent == pytest.approx(0.4)
    assert errors.baseline_percent == pytest.approx(1.0)
    assert errors.rotation_deg == pytest.approx(0.05, abs=1e-4)
    assert errors.turn_y_deg == pytest.approx(0.03, abs=1e-4)
    assert errors.vergence_deg == pytest.approx(0.03, abs=2e-3)
    assert errors.roll_deg == pytest.approx(0.04, abs=2e-3)


def test_vergence_error_vanishes_when_the_principal_point_compensates_a_turn() -> None:
    K2 = truth().K2.copy()
    # As many pixels as 0.05 degrees at the image centre.
    K2[0, 2] += np.radians(0.05) * K2[0, 0]
    for degrees in (0.05, -0.05):
        other = replace(truth(), K2=K2, R=small_rotation(0.0, degrees, 0.0) @ truth().R)
        errors = camera_errors(other, truth())
        assert errors.turn_y_deg == pytest.approx(0.05, abs=1e-4)
        small, large = errors.vergence_deg < 0.002, 0.098 < errors.vergence_deg < 0.102
        assert small or large
        if small:
            return
    pytest.fail("neither turn was compensated")


def test_row_error_of_exact_corners_equals_the_relative_pitch() -> None:
    world = World(load_scenario(BOARD_SCENARIO), 0)
    assert world.board is not None
    assert exact_row_error_p95(world, world.board, truth()) < 0.001
    pitched = replace(truth(), R=small_rotation(0.05, 0.0, 0.0) @ truth().R)
    expected = np.radians(0.05) * truth().K1[1, 1]
    # Away from the image centre a rotation moves a row by up to 1 + (y / f)^2.
    p95 = exact_row_error_p95(world, world.board, pitched)
    assert expected < p95 < 1.25 * expected


def test_depth_error_of_the_true_calibration_is_matching_error() -> None:
    right = depth_accuracy(place(), truth(), scenes())
    assert right.count > 500
    assert 0.8 < right.matched <= 1.0
    assert right.median_percent is not None
    assert right.bias_percent is not None
    assert right.spread_percent is not None
    assert right.median_percent < 2.0
    assert abs(right.bias_percent) < 1.0
    assert 0.2 < right.spread_percent < 4.0


def test_baseline_and_vergence_errors_bias_depth_as_predicted() -> None:
    right = depth_accuracy(place(), truth(), scenes())
    long = depth_accuracy(place(), replace(truth(), T=1.03 * truth().T), scenes())
    assert right.bias_percent is not None
    assert long.bias_percent is not None
    assert long.bias_percent - right.bias_percent == pytest.approx(3.0, abs=0.3)
    turned = replace(truth(), R=small_rotation(0.0, 0.1, 0.0) @ truth().R)
    bias = depth_accuracy(place(), turned, scenes()).bias_percent
    assert bias is not None
    # The relative bias is the angle in radians times Z / B: 0.1 degrees, 3 m and 0.12 m.
    assert abs(bias - right.bias_percent) == pytest.approx(
        100 * np.radians(0.1) * 3.0 / truth().baseline, rel=0.25
    )


def test_depth_accuracy_is_unknown_without_samples() -> None:
    none = depth_accuracy(place(), truth(), [])
    assert (none.count, none.median_percent, none.bias_percent) == (0, None, None)


def test_board_and_depth_scenes_share_cameras_for_any_seed() -> None:
    for seed in (1, 5):
        for name in (BOARD_SCENARIO, DEPTH_SCENARIO):
            other = World(load_scenario(name), seed).true_calibration
            assert same_cameras(other, truth())
    assert not same_cameras(truth(), replace(truth(), T=1.001 * truth().T))


@pytest.mark.patient
def test_few_views_calibrate_and_give_all_figures() -> None:
    ticks = iter(range(1000))
    run = calibration_accuracy(3, poses=7, scenes=1, clock=lambda: float(next(ticks)))
    assert run.poses == 7
    assert 6 <= run.pairs <= 7
    assert run.detection_s == 7.0, "the search in each pair takes one tick"
    assert run.fit_s == 1.0
    # There are seven views, fewer than usual, so the limits are looser.
    assert 0.0 < run.errors.focal_percent < 0.5
    assert run.errors.vergence_deg < 0.02
    assert 0.0 < run.exact_p95_px < 0.2
    assert run.held_out_p95_px is not None
    assert run.exact_p95_px < run.held_out_p95_px < 0.4
    assert run.depth.median_percent is not None
    assert run.depth.median_percent < 2.5
    assert asdict(run)["errors"]["turn_y_deg"] == run.errors.turn_y_deg


def test_worst_seed_decides() -> None:
    both = calibration_targets([figures(0.1), figures(0.2), figures(0.31)])
    worst, median = (
        next(t for t in both[name] if t.figure.startswith("focal")) for name in ("worst", "median")
    )
    assert (worst.measured, worst.most, worst.reached, worst.count) == (0.31, 0.3, False, 3)
    assert (median.measured, median.reached) == (0.2, True)
    unknown = calibration_targets([figures(), figures(held_out=None)])["worst"]
    rows = next(t for t in unknown if t.figure.startswith("rows"))
    assert (rows.measured, rows.reached) == (None, False)


def test_tables_have_a_row_per_seed_and_mark_missed_targets() -> None:
    text = calibration_markdown([figures(0.1, seed=4), figures(0.5, seed=7)])
    assert "| focal length, % | <= 0.3 | 0.500 | **no** | 0.300 | yes |" in text
    assert "| depth at 3 m, median, % | <= 2 | 1.000 | yes | 1.000 | yes |" in text
    for row in ("| 4 | 20 | 19 | 0 | 0.100 |", "| 7 | 20 | 19 | 0 | 0.500 |"):
        assert row in text
    assert "| largest | 0.900 | 1.000 | -0.500 |" in text
