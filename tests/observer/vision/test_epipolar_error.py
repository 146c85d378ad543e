"""Row errors of a pair: shift, roll and stretch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.number_format import format_number
from observer.vision.epipolar_error import epipolar_error, epipolar_reason

from .image_pairs import CAMERA, lowered, measured_rows, scene, turned


def rows_of(
    px: np.ndarray, shift: float, roll_deg: float, stretch: float, noise: float
) -> np.ndarray:
    """v_left - v_right when the right image is shifted down, rotated clockwise and stretched."""
    rng = np.random.default_rng(7)
    u, v = (px - (CAMERA.cx, CAMERA.cy)).T
    return -(shift + np.radians(roll_deg) * u + stretch * v) + rng.normal(0, noise, len(px))


@pytest.fixture
def places() -> np.ndarray:
    return np.random.default_rng(3).uniform((0, 0), (511, 255), (200, 2))


def test_shift_roll_and_stretch_are_separated_despite_outliers(places: np.ndarray) -> None:
    wrong = rows_of(places, 0.8, 0.4, 0.006, 0.2)
    wrong[:50] = np.random.default_rng(1).uniform(-20, 20, 50)
    error = epipolar_error(places, wrong, CAMERA)
    assert error is not None
    assert error.median_px == pytest.approx(-0.8, abs=0.25)
    assert np.degrees(error.roll_rad) == pytest.approx(0.4, abs=0.03)
    assert error.stretch == pytest.approx(0.006, abs=0.001)
    assert 140 <= error.count <= 165
    # RMS of the fitted plane over the image, from terms 0.8, 1.79 / sqrt 3 and 0.77 / sqrt 3.
    assert error.typical_px == pytest.approx(1.38, abs=0.08)
    assert 1.4 < error.p95_px < 3.5


def test_stated_deviation_matches_the_scatter() -> None:
    rng = np.random.default_rng(5)
    found, stated = [], []
    for _ in range(200):
        px = rng.uniform((0, 0), (511, 255), (60, 2))
        error = epipolar_error(px, 1.0 + rng.normal(0, 0.5, 60), CAMERA)
        assert error is not None
        found.append(error.typical_px)
        stated.append(error.typical_std_px)
    assert np.std(found) == pytest.approx(np.median(stated), rel=0.35)


def test_too_few_rows_give_no_error(places: np.ndarray) -> None:
    assert epipolar_error(places[:19], np.full(19, 5.0), CAMERA) is None
    unknown = np.full(len(places), np.nan)
    unknown[:19] = 5.0
    assert epipolar_error(places, unknown, CAMERA) is None
    assert epipolar_reason(None) is None
    assert epipolar_error(places[:20], np.full(20, 5.0), CAMERA) is not None


def test_few_noisy_rows_raise_no_alarm() -> None:
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(200):
        px = rng.uniform((0, 0), (511, 255), (25, 2))
        alarms += epipolar_reason(
            epipolar_error(px, 0.8 + rng.normal(0, 1.0, 25), CAMERA)
        ) is not None  # fmt: skip
    assert alarms <= 4


def test_collinear_points_give_a_finite_error_and_no_alarm() -> None:
    px = np.stack([np.linspace(10, 500, 60), np.full(60, 40.0)], axis=1)
    noise = np.random.default_rng(0).normal(0, 0.2, 60)
    error = epipolar_error(px, noise, CAMERA)
    assert error is not None
    assert np.isfinite([error.typical_px, error.typical_std_px, error.roll_rad]).all()
    assert epipolar_reason(error) is None


@pytest.mark.parametrize(
    ("fault", "median_px", "roll_deg"),
    [
        (lambda image: lowered(image, 2), -2.0, 0.0),
        (lambda image: turned(image, 0.5), 0.0, 0.5),
        (lambda image: turned(lowered(image, 2), -0.5), -2.0, -0.5),
    ],
    ids=["2 rows", "0.5 deg", "both"],
)
@pytest.mark.parametrize("name", ["lateral", "low_texture_flicker", "turning"])
def test_row_errors_of_images_are_reported_with_numbers(
    name: str, fault: Callable[[np.ndarray], np.ndarray], median_px: float, roll_deg: float
) -> None:
    left, right = scene(name)[1][0]
    error = measured_rows((left, fault(right)), CAMERA)
    assert error is not None
    # Rotation shifts features off the centre, so the median depends on how they are distributed.
    assert error.median_px == pytest.approx(median_px, abs=0.25 if roll_deg == 0 else 0.8)
    assert np.degrees(error.roll_rad) == pytest.approx(roll_deg, abs=0.06)
    reported = epipolar_reason(error)
    assert reported is not None
    assert f"median {format_number(error.median_px, 1, signed=True)} px" in reported
    rotation = format_number(float(np.degrees(error.roll_rad)), 2, signed=True)
    assert f"rotation {rotation} deg" in reported
    assert "the limit is 1 px" in reported
    assert epipolar_reason(error, warn_px=4.0) is None
