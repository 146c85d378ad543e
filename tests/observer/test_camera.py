"""Calibrations are validated on construction; a rectified pair's geometry is exact."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCalibration, StereoCamera, as_gray
from observer.errors import CalibrationError

CAMERA = StereoCamera(512, 256, 443.0, 440.0, 250.0, 130.0, 0.12)
GOOD = StereoCalibration.rectified(512, 256, 443, 440, 250, 130, 0.12)


@settings(max_examples=50)
@given(u=st.floats(0, 511), v=st.floats(0, 255), d=st.floats(0.5, 120))
def test_projection_inverts_triangulation(u: float, v: float, d: float) -> None:
    px, disparity = CAMERA.project(CAMERA.triangulate((u, v), d))
    np.testing.assert_allclose(px, (u, v), atol=1e-6)
    assert disparity == pytest.approx(d)


def test_a_known_point_is_projected_correctly() -> None:
    px, disparity = CAMERA.project((0.5, -0.25, 2.0))
    np.testing.assert_allclose(px, (250 + 443 / 4, 130 - 440 / 8))
    assert disparity == pytest.approx(443 * 0.12 / 2)


@pytest.mark.parametrize("disparity", [0.0, -3.0, np.nan, -np.inf])
def test_an_invalid_disparity_gives_nan(disparity: float) -> None:
    assert np.isnan(CAMERA.triangulate((10, 20), disparity)).all()


def test_points_behind_the_camera_give_nan() -> None:
    px, disparity = CAMERA.project([[0, 0, -1.0], [0, 0, 0.0], [0, 0, 1.0]])
    assert np.isnan(px[:2]).all()
    assert np.isnan(disparity[:2]).all()
    assert np.isfinite(px[2]).all()


def test_the_point_covariance_matches_their_scatter() -> None:
    rng = np.random.default_rng(0)
    px = np.array([400.0, 60.0]) + rng.normal(0, 0.3, (20000, 2))
    disparity = 26.0 + rng.normal(0, 0.2, 20000)
    scatter = np.cov(CAMERA.triangulate(px, disparity).T)
    (stated,) = CAMERA.point_covariance([[400.0, 60.0]], [26.0], 0.3, 0.2)
    np.testing.assert_allclose(scatter, stated, atol=0.03 * np.abs(scatter).max())
    depth = 443 * 0.12 / 26
    assert np.sqrt(stated[2, 2]) == pytest.approx(depth**2 * 0.2 / (443 * 0.12))


def test_a_valid_calibration_is_accepted_and_immutable() -> None:
    assert GOOD.is_rectified
    assert GOOD.baseline == pytest.approx(0.12)
    with pytest.raises(ValueError, match="read-only"):
        GOOD.K1[0, 0] = 1


def test_differing_cameras_are_not_rectified() -> None:
    K = np.array(GOOD.K1)
    K[0, 0] += 1
    for change in (
        {"K2": K},
        {"D1": [0.1, 0, 0, 0, 0]},
        {"T": [-0.12, 0.001, 0]},
        {"T": [0.12, 0, 0]},
    ):
        assert not dataclasses.replace(GOOD, **change).is_rectified


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"width": 0}, "image_width"),
        ({"K1": np.zeros((3, 3))}, "K1 must be a camera matrix"),
        (
            {"K1": np.diag([1e-9, 250.0, 1.0])},
            "K1 has the focal lengths 1e-09 and 250 pixels, which no camera has for images",
        ),
        ({"K2": np.diag([1e9, 1e9, 1.0])}, "K2 has the focal lengths 1e\\+09 and 1e\\+09 pixels"),
        ({"K2": np.diag([200.0, 450.0, 1.0])}, "they must be nearly the same"),
        ({"K2": np.eye(2)}, "K2 must have shape 3 x 3, not 2 x 2"),
        ({"D1": [0.1, 0.2, 0.3]}, "D1 must contain 4, 5, 8, 12 or 14"),
        ({"R": np.diag([1.0, 1.0, -1.0])}, "R must be a rotation"),
        ({"T": [np.nan, 0, 0]}, "T must contain only finite numbers"),
        ({"T": ["a", 0, 0]}, "T must be an array of numbers"),
        ({"T": [0, 0, 0]}, "need a baseline"),
        ({"T": [-120, 0, 0]}, "if T is in millimetres, divide it by 1000"),
        ({"T": [-1e-5, 0, 0]}, "outside 0.001 to 2 m"),
    ],
)
def test_an_impossible_calibration_is_refused_with_a_reason(
    change: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        dataclasses.replace(GOOD, **change)


def test_grey_images_are_not_copied_and_colour_becomes_luma() -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert as_gray(grey) is grey
    blue = np.zeros((3, 4, 3), np.uint8)
    blue[..., 0] = 255
    assert (as_gray(blue) == 29).all()
