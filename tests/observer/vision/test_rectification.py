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

WIDTH, HEIGHT = 320, 240


def crooked(rotvec: tuple[float, float, float] = (0.01, -0.02, 0.015)) -> StereoCalibration:
    """A pair of unequal cameras with lens distortion and a rotated right camera."""
    return StereoCalibration(
        WIDTH,
        HEIGHT,
        K1=np.array([[260.0, 0, 158], [0, 262, 121], [0, 0, 1]]),
        D1=np.array([-0.28, 0.09, 0.001, -0.0005, 0.0]),
        K2=np.array([[264.0, 0, 163], [0, 263, 117], [0, 0, 1]]),
        D2=np.array([-0.25, 0.07, -0.001, 0.0008, 0.0]),
        R=np.asarray(cv2.Rodrigues(np.array(rotvec))[0], np.float64),
        T=np.array([-0.12, 0.003, 0.002]),
    )


def points_in_view(seed: int = 0, count: int = 40) -> NDArray[np.float64]:
    """(N, 3) metres, frame of the unrectified left camera, 1.5 to 6 m away."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.5, 6, count)
    return np.stack([z * rng.uniform(-0.4, 0.4, count), z * rng.uniform(-0.3, 0.3, count), z], 1)


def projected(calibration: StereoCalibration, points: NDArray[np.float64]) -> list[np.ndarray]:
    """Distorted pixels (N, 2) in the left and the right image."""
    zero = np.zeros(3)
    rotvec = cv2.Rodrigues(calibration.R)[0]
    left = cv2.projectPoints(points, zero, zero, calibration.K1, calibration.D1)[0]
    right = cv2.projectPoints(points, rotvec, calibration.T, calibration.K2, calibration.D2)[0]
    return [left.reshape(-1, 2), right.reshape(-1, 2)]


def spots(px: NDArray[np.float64]) -> Image:
    """A Gaussian spot of 2.5 px at each sub-pixel position."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    image = np.zeros((HEIGHT, WIDTH))
    for x, y in px:
        image += 220 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * 2.5**2))
    return np.clip(image, 0, 255).astype(np.uint8)


def centre_near(image: Image, px: NDArray[np.float64]) -> NDArray[np.float64]:
    u, v = np.round(px).astype(int)
    window = image[v - 7 : v + 8, u - 7 : u + 8].astype(float)
    dv, du = np.mgrid[-7:8, -7:8]
    return np.array(
        [u + (window * du).sum() / window.sum(), v + (window * dv).sum() / window.sum()]
    )


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
@settings(deadline=None, max_examples=40)
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


def fisheye(
    rotvec: tuple[float, float, float] = (0.01, -0.02, 0.015), focal: float = 150.0
) -> StereoCalibration:
    """Equidistant lenses of about 120 degrees across (160 at a focal length of 115)."""
    return StereoCalibration(
        WIDTH,
        HEIGHT,
        K1=np.array([[focal, 0, 158], [0, focal + 1, 121], [0, 0, 1]]),
        D1=np.array([0.02, -0.006, 0.002, -0.0004]),
        K2=np.array([[focal - 2, 0, 163], [0, focal - 1, 117], [0, 0, 1]]),
        D2=np.array([-0.01, 0.004, -0.001, 0.0002]),
        R=np.asarray(cv2.Rodrigues(np.array(rotvec))[0], np.float64),
        T=np.array([-0.12, 0.003, 0.002]),
        distortion_model="equidistant",
    )


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
@settings(deadline=None, max_examples=30)
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
