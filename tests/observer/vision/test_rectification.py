"""Rectification: geometry by construction, refusals, and KITTI's raw images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from observer.calibration.formats.kitti_file import read_kitti_raw
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.sources.folders import open_folder
from observer.types import Image, StereoFrame
from observer.vision.rectification import Rectification

from .uncalibrated_pairs import HEIGHT, WIDTH, centre_near, crooked, fisheye, points_in_view, spots


def projected(calibration: StereoCalibration, points: NDArray[np.float64]) -> list[np.ndarray]:
    """Distorted pixels (N, 2) in the left and the right image."""
    zero = np.zeros(3)
    rotvec = cv2.Rodrigues(calibration.R)[0]
    left = cv2.projectPoints(points, zero, zero, calibration.K1, calibration.D1)[0]
    right = cv2.projectPoints(points, rotvec, calibration.T, calibration.K2, calibration.D2)[0]
    return [left.reshape(-1, 2), right.reshape(-1, 2)]


@pytest.mark.parametrize("seed", range(6))
def test_point_appears_where_the_rectified_camera_projects_it(seed: int) -> None:
    calibration = crooked()
    rectification = Rectification(calibration)
    camera = rectification.camera
    point = points_in_view(seed, 1)
    images = rectification.apply(*(spots(px) for px in projected(calibration, point)))
    expected, disparity = camera.project(point @ rectification.R_rectified_left.T)
    left = centre_near(images[0], expected[0])
    right = centre_near(images[1], expected[0] - [disparity[0], 0])
    assert left == pytest.approx(expected[0], abs=0.1)
    assert right == pytest.approx(expected[0] - [disparity[0], 0], abs=0.1)
    triangulated = camera.triangulate(left, left[0] - right[0]) @ rectification.R_rectified_left
    assert triangulated == pytest.approx(point[0], rel=0.02, abs=0.02)


@given(
    rotvec=st.tuples(*[st.floats(-0.06, 0.06)] * 3),
    t=st.tuples(st.floats(-0.5, -0.05), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
)
@settings(max_examples=40)
def test_rows_agree_for_any_pair(
    rotvec: tuple[float, float, float], t: tuple[float, float, float]
) -> None:
    calibration = replace(crooked(rotvec), T=np.array(t))
    rectification = Rectification(calibration)
    points = points_in_view()
    pixels = projected(calibration, points)
    # Analytic, by undistorting points: no images, hence no interpolation.
    K = rectification.camera.K
    R1 = rectification.R_rectified_left
    left = cv2.undistortPoints(pixels[0], calibration.K1, calibration.D1, R=R1, P=K).reshape(-1, 2)
    expected, disparity = rectification.camera.project(points @ R1.T)
    assert left == pytest.approx(expected, abs=0.02)
    assert (disparity > 0).all()
    assert rectification.camera.baseline == pytest.approx(calibration.baseline)
    R2 = R1 @ calibration.R.T
    right = cv2.undistortPoints(pixels[1], calibration.K2, calibration.D2, R=R2, P=K).reshape(-1, 2)
    assert right[:, 1] == pytest.approx(left[:, 1], abs=0.05)


def test_every_pixel_comes_from_the_input() -> None:
    white = np.full((HEIGHT, WIDTH), 255, np.uint8)
    left, right = Rectification(crooked()).apply(white, white)
    assert left.min() == 255
    assert right.min() == 255


def test_colour_is_preserved_and_the_input_is_unchanged() -> None:
    colour = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    before = colour.copy()
    left, right = Rectification(crooked()).apply(colour, colour)
    assert left.shape == right.shape == (HEIGHT, WIDTH, 3)
    assert left.dtype == np.uint8
    assert np.array_equal(colour, before)
    assert not np.array_equal(left, colour)


def test_rectified_pair_is_passed_through() -> None:
    calibration = StereoCalibration.rectified(WIDTH, HEIGHT, 300.125, 301.5, 160.2, 119.9, 0.12)
    rectification = Rectification(calibration)
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    left, right = rectification.apply(image, image)
    assert left is image
    assert right is image
    assert np.array_equal(rectification.camera.K, calibration.K1)
    assert rectification.camera.baseline == 0.12
    assert np.array_equal(rectification.R_rectified_left, np.eye(3))


def test_two_runs_give_the_same_pixels() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    first = Rectification(crooked()).apply(noise, noise)
    second = Rectification(crooked()).apply(noise, noise)
    assert np.array_equal(first, second)


@pytest.mark.parametrize("calibration", [
    crooked(), StereoCalibration.rectified(WIDTH, HEIGHT, 300, 300, 160, 120, 0.1),
])  # fmt: skip
@pytest.mark.parametrize("side", [0, 1])
def test_refuses_images_of_another_size(calibration: StereoCalibration, side: int) -> None:
    images = [np.zeros((HEIGHT, WIDTH), np.uint8)] * 2
    images[side] = np.zeros((WIDTH, HEIGHT), np.uint8)
    with pytest.raises(CalibrationError) as caught:
        Rectification(calibration).apply(*images)
    assert "image is 240x320 pixels, but the calibration is for 320x240" in str(caught.value)
    assert ("left", "right")[side] in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"T": np.array([0.12, 0, 0])}, "swap left and right"),
        ({"T": np.array([0, -0.12, 0])}, "must be side by side"),
        ({"T": np.array([0.01, 0, -0.12])}, "must be side by side"),
        # Rotated by 180 degrees, the same T places the right camera on the left.
        ({"R": cv2.Rodrigues(np.array([0, 0, np.pi]))[0]}, "swap left and right"),
        ({"D1": np.array([-300.0, 90, 0, 0, 0])}, "cannot be rectified"),
        ({"D2": np.array([3e5, -9e6, 0, 0, 1e9])}, "cannot be rectified"),
    ],
)
def test_refuses_unrectifiable_pairs(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(CalibrationError, match=expected):
        Rectification(replace(crooked(), **changes))


def vertical_errors(left: Image, right: Image) -> NDArray[np.float64]:
    """(N,) pixels: sub-pixel v_right - v_left of unambiguously matched SIFT features."""
    sift = cv2.SIFT.create(1000)
    left_points, left_values = sift.detectAndCompute(left, None)
    right_points, right_values = sift.detectAndCompute(right, None)
    pairs = cv2.BFMatcher().knnMatch(left_values, right_values, 2)
    good = [best for best, second in pairs if best.distance < 0.7 * second.distance]
    a = np.array([left_points[match.queryIdx].pt for match in good])
    b = np.array([right_points[match.trainIdx].pt for match in good])
    # Scene points lie further left in the right image; all others are mismatches.
    trusted = (b[:, 0] - a[:, 0] < 1) & (np.abs(b[:, 1] - a[:, 1]) < 20)
    assert trusted.sum() > 100
    return np.asarray((b - a)[trusted, 1], dtype=np.float64)


def test_kitti_raw_is_rectified(shared_data: Path) -> None:
    folder = shared_data / "kitti_raw_unrectified"
    source = open_folder(folder)
    assert source.calibration is not None
    refined = Rectification(source.calibration)
    as_published = Rectification(
        read_kitti_raw(folder / "calib_cam_to_cam.txt", 0, source.info.width, source.info.height)
    )
    errors: dict[str, list[NDArray[np.float64]]] = {"raw": [], "published": [], "refined": []}
    while (frame := source.read()) is not None:
        assert isinstance(frame, StereoFrame)
        if frame.index % 8 != 2:  # only pairs that the refinement did not use
            continue
        errors["raw"].append(vertical_errors(frame.left, frame.right))
        errors["published"].append(vertical_errors(*as_published.apply(frame.left, frame.right)))
        errors["refined"].append(vertical_errors(*refined.apply(frame.left, frame.right)))
    median = {name: np.median(np.abs(np.concatenate(each))) for name, each in errors.items()}
    assert median["raw"] > 2
    # KITTI's own rectification of these images (R_rect, P_rect) leaves the same error.
    assert median["published"] < 0.6
    assert median["refined"] < 0.3


def test_kitti_odometry_needs_no_rectification(shared_data: Path) -> None:
    source = open_folder(shared_data / "kitti_static")
    assert source.calibration is not None
    frame = source.read()
    assert isinstance(frame, StereoFrame)
    left, right = Rectification(source.calibration).apply(frame.left, frame.right)
    assert left is frame.left
    assert np.median(np.abs(vertical_errors(left, right))) < 0.6


def test_points_and_images_are_rectified_alike() -> None:
    calibration = crooked()
    rectification = Rectification(calibration)
    points = points_in_view()
    left, right = rectification.rectify_points(*projected(calibration, points))
    expected, disparity = rectification.camera.project(points @ rectification.R_rectified_left.T)
    assert left == pytest.approx(expected, abs=1e-4)
    expected[:, 0] -= disparity
    assert right == pytest.approx(expected, abs=1e-4)


def test_points_of_a_rectified_pair_are_unchanged() -> None:
    calibration = StereoCalibration.rectified(WIDTH, HEIGHT, 300, 300, 160, 120, 0.12)
    left, right = Rectification(calibration).rectify_points([[1.5, 2.5]], np.empty((0, 2)))
    assert left.tolist() == [[1.5, 2.5]]
    assert right.shape == (0, 2)


@pytest.mark.parametrize("calibration", [crooked(), fisheye()])
def test_non_finite_pixels_become_nan(calibration: StereoCalibration) -> None:
    nowhere = [[np.nan, 3.0], [160.0, np.inf], [160.0, 120.0]]
    left, right = Rectification(calibration).rectify_points(nowhere, np.empty((0, 2)))
    assert np.isnan(left[:2]).all()
    assert np.isfinite(left[2]).all()
    assert right.shape == (0, 2)


def test_pinhole_rectification_matches_opencv_exactly() -> None:
    calibration = crooked()
    size = (WIDTH, HEIGHT)
    R1, R2, P1, P2 = cv2.stereoRectify(
        calibration.K1, calibration.D1, calibration.K2, calibration.D2, size, calibration.R,
        calibration.T.reshape(3, 1), flags=cv2.CALIB_ZERO_DISPARITY, alpha=0, newImageSize=size,
    )[:4]  # fmt: skip
    noise = np.random.default_rng(1).integers(0, 255, (2, HEIGHT, WIDTH), dtype=np.uint8)
    expected = [
        cv2.remap(image, *cv2.initUndistortRectifyMap(K, D, R, P, size, cv2.CV_16SC2),
                  cv2.INTER_LINEAR)
        for image, K, D, R, P in (
            (noise[0], calibration.K1, calibration.D1, R1, P1),
            (noise[1], calibration.K2, calibration.D2, R2, P2),
        )
    ]  # fmt: skip
    rectification = Rectification(calibration)
    assert np.array_equal(rectification.apply(noise[0], noise[1]), expected)
    assert np.array_equal(rectification.R_rectified_left, R1)
    assert np.array_equal(rectification.R_rectified_right, R2)
    assert np.array_equal(rectification.camera.K, P1[:, :3])
    assert rectification.camera.baseline == -P2[0, 3] / P2[0, 0]
