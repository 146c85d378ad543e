"""Rectification of fisheye pairs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from observer.errors import CalibrationError
from observer.vision.rectification import Rectification

from .uncalibrated_pairs import HEIGHT, WIDTH, centre_near, fisheye, points_in_view, spots


def seen_by_fisheye(
    points: NDArray[np.float64], K: NDArray[np.float64], D: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Pixels (N, 2) of points (N, 3) in the camera's frame, by the lens model point by point."""
    px = []
    for x, y, z in points:
        theta = np.arctan2(np.hypot(x, y), z)
        bent = theta + sum(k * theta ** (2 * i + 3) for i, k in enumerate(D))
        phi = np.arctan2(y, x)
        px.append([K[0, 0] * bent * np.cos(phi) + K[0, 2], K[1, 1] * bent * np.sin(phi) + K[1, 2]])
    return np.array(px)


def wide_points(count: int = 60) -> NDArray[np.float64]:
    """(N, 3) metres, unrectified left camera frame: up to 50 degrees off axis, 0.7 to 6 m away."""
    rng = np.random.default_rng(3)
    angle, around = rng.uniform(0, np.deg2rad(50), count), rng.uniform(0, 2 * np.pi, count)
    rays = np.stack(
        [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], 1
    )
    return rays * rng.uniform(0.7, 6, (count, 1))


@given(
    rotvec=st.tuples(*[st.floats(-0.06, 0.06)] * 3),
    t=st.tuples(st.floats(-0.5, -0.05), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
)
@settings(max_examples=30)
def test_fisheye_rows_agree_and_triangulate_correctly(
    rotvec: tuple[float, float, float], t: tuple[float, float, float]
) -> None:
    calibration = replace(fisheye(rotvec), T=np.array(t))
    rectification = Rectification(calibration)
    points = wide_points()
    left, right = rectification.rectify_points(
        seen_by_fisheye(points, calibration.K1, calibration.D1),
        seen_by_fisheye(points @ calibration.R.T + calibration.T, calibration.K2, calibration.D2),
    )
    assert left[:, 1] == pytest.approx(right[:, 1], abs=0.05)
    camera = rectification.camera
    assert camera.baseline == pytest.approx(calibration.baseline)
    there = camera.triangulate(left, left[:, 0] - right[:, 0]) @ rectification.R_rectified_left
    assert there == pytest.approx(points, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_fisheye_image_and_points_are_rectified_alike(seed: int) -> None:
    calibration = fisheye()
    rectification = Rectification(calibration)
    point = points_in_view(seed, 1)
    px = (
        seen_by_fisheye(point, calibration.K1, calibration.D1),
        seen_by_fisheye(point @ calibration.R.T + calibration.T, calibration.K2, calibration.D2),
    )
    images = rectification.apply(*(spots(each) for each in px))
    for image, expected in zip(images, rectification.rectify_points(*px), strict=True):
        # The perspective stretch makes a spot of 2.5 px oval.
        assert centre_near(image, expected[0]) == pytest.approx(expected[0], abs=0.2)


@pytest.mark.parametrize("focal", [115.0, 150.0, 260.0, 600.0])
@pytest.mark.parametrize("yaw", [-0.1, 0.0, 0.06])
def test_rectified_fisheye_image_is_filled_and_as_wide_as_possible(
    focal: float, yaw: float
) -> None:
    rectification = Rectification(fisheye((0.02, yaw, -0.01), focal))
    white = np.full((HEIGHT, WIDTH), 255, np.uint8)
    for image in rectification.apply(white, white):
        assert image.min() == 255
    camera = rectification.camera
    across = np.rad2deg(2 * np.arctan(WIDTH / 2 / camera.fx))
    # Either it has the maximum width, or a frame 1 % wider would exceed a source image.
    if across < 119:
        corners = np.array([
            [u, v, 1.0] for u in np.linspace(-1.01, 1.01, 41) for v in np.linspace(-1.01, 1.01, 41)
        ]) * [WIDTH / 2, HEIGHT / 2, camera.fx]  # fmt: skip
        corners[:, :2] += [(WIDTH - 1) / 2 - camera.cx, (HEIGHT - 1) / 2 - camera.cy]
        calibration = fisheye((0.02, yaw, -0.01), focal)
        px = np.concatenate([
            seen_by_fisheye(corners @ rectification.R_rectified_left, calibration.K1,
                            calibration.D1),
            seen_by_fisheye(corners @ rectification.R_rectified_right, calibration.K2,
                            calibration.D2),
        ])  # fmt: skip
        assert ((px < 0) | (px > [WIDTH - 1, HEIGHT - 1])).any()


def test_hemispherical_lens_gives_a_plane_image_of_120_degrees() -> None:
    wide = replace(fisheye(focal=100.0), D1=np.zeros(4), D2=np.zeros(4))  # 320 px are 183 degrees
    camera = Rectification(wide).camera
    assert np.rad2deg(2 * np.arctan((WIDTH - 1) / 2 / camera.fx)) == pytest.approx(120)
    left, right = Rectification(wide).rectify_points([[0.0, 120.0]], [[160.0, 120.0]])
    # A plane image cannot show a ray 90 degrees off axis.
    assert np.isnan(left).all()
    assert np.isfinite(right).all()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"T": np.array([0.12, 0, 0])}, "swap left and right"),
        ({"D1": np.array([-300.0, 0, 0, 0])}, "cannot be rectified"),
        ({"R": cv2.Rodrigues(np.array([1.2, 0, 0]))[0]}, "cannot be rectified"),
        ({"D2": np.array([1e200, 0, 0, -1e200])}, "cannot be rectified"),
    ],
)
def test_refuses_fisheye_pairs_that_cannot_be_rectified(
    changes: dict[str, Any], expected: str
) -> None:
    with pytest.raises(CalibrationError, match=expected):
        Rectification(replace(fisheye(focal=400.0), **changes))
