"""Disparity of rendered pairs, sampling between pixels, and the display cloud."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.parameters import StereoParameters
from observer.vision.stereo import (
    disparity_around,
    disparity_map,
    point_cloud,
    sample_disparity,
)

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


def pair(far: float = 12.0, near: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """A wall at disparity ``far`` and in front a board (150..300, 80..180) at ``near``."""
    rng = np.random.default_rng(4)
    noise = rng.integers(0, 256, (2, 256, 700)).astype(np.uint8)
    wall, board = (
        cv2.normalize(cv2.GaussianBlur(n, (0, 0), 1.5), None, 10, 245, cv2.NORM_MINMAX)
        for n in noise
    )
    images = []
    for is_right in (0, 1):
        v, u = np.mgrid[0:256, 0:512].astype(np.float32)
        image = cv2.remap(wall, u + 60 + is_right * far, v, cv2.INTER_CUBIC)
        on_board = u + is_right * near
        front = cv2.remap(board, on_board, v, cv2.INTER_CUBIC)
        is_board = (on_board >= 150) & (on_board < 300) & (v >= 80) & (v < 180)
        image = np.where(is_board, front, image) + rng.normal(0, 2, image.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images[0], images[1]


@pytest.mark.parametrize("matcher", ["bm", "sgbm"])
@pytest.mark.parametrize(("far", "near"), [(12.0, 30.0), (7.5, 45.25)])
def test_disparity_is_correct_where_known(matcher: str, far: float, near: float) -> None:
    disparity = disparity_map(*pair(far, near), StereoParameters(matcher=matcher))
    assert disparity.shape == (256, 512)
    assert disparity.dtype == np.float32
    for true, area in ((near, disparity[95:165, 165:285]), (far, disparity[20:60, 60:490])):
        known = np.isfinite(area)
        assert known.mean() > (0.9 if matcher == "sgbm" else 0.5)
        assert np.median(area[known]) == pytest.approx(true, abs=0.15)
        assert np.mean(np.abs(area[known] - true) < 0.5) > 0.95


def test_left_edge_is_matched_as_far_as_the_right_camera_sees_it() -> None:
    disparity = disparity_map(*pair(), StereoParameters(max_disparity_px=96))
    assert np.isfinite(disparity[20:60, 20:90]).mean() > 0.8
    columns = np.arange(512)
    assert not (disparity > columns).any()


@pytest.mark.parametrize("matcher", ["bm", "sgbm"])
def test_images_without_texture_have_no_disparity(matcher: str) -> None:
    grey = np.full((128, 256), 90, np.uint8)
    disparity = disparity_map(grey, grey, StereoParameters(matcher=matcher))
    assert not np.isfinite(disparity).any()


def test_threads_do_not_change_the_result() -> None:
    images = pair()
    before = cv2.getNumThreads()
    try:
        results = []
        for threads in (1, 2, 5):
            cv2.setNumThreads(threads)
            results.append(disparity_map(*images, StereoParameters()))
    finally:
        cv2.setNumThreads(before)
    for other in results[1:]:
        np.testing.assert_array_equal(results[0], other)


def test_disparity_around_points_matches_the_whole_image() -> None:
    images = pair()
    px = np.array([[180, 100], [260, 150]], np.float32)
    part = disparity_around(*images, px, StereoParameters())
    whole = disparity_map(*images, StereoParameters())
    area = (slice(100, 151), slice(180, 261))
    assert np.isfinite(part[area]).mean() > 0.9
    both = np.isfinite(part[area]) & np.isfinite(whole[area])
    assert np.percentile(np.abs(part[area] - whole[area])[both], 99) < 0.2
    assert not np.isfinite(part[:, 400:]).any()
    assert not np.isfinite(part[220:]).any()


def test_disparity_around_no_points_is_unknown() -> None:
    nothing = disparity_around(*pair(), np.empty((0, 2), np.float32), StereoParameters())
    assert nothing.shape == (256, 512)
    assert not np.isfinite(nothing).any()


@pytest.mark.parametrize("px", [(0.0, 0.0), (511.0, 255.0), (3.0, 250.0), (505.0, 2.0)])
def test_disparity_around_a_border_point_has_full_image_size(px: tuple[float, float]) -> None:
    around = disparity_around(*pair(), np.array([px], np.float32), StereoParameters())
    assert around.shape == (256, 512)


def plane(a: float, b: float, c: float) -> np.ndarray:
    v, u = np.mgrid[0:40, 0:60]
    return (a + b * u + c * v).astype(np.float32)


@settings(max_examples=40)
@given(u=st.floats(0, 59), v=st.floats(0, 39), b=st.floats(-0.3, 0.3), c=st.floats(-0.3, 0.3))
def test_sampling_a_plane_is_exact(u: float, v: float, b: float, c: float) -> None:
    px = np.array([[u, v]], np.float32)
    expected = 30 + b * float(px[0, 0]) + c * float(px[0, 1])
    assert sample_disparity(plane(30, b, c), px)[0] == pytest.approx(expected, abs=1e-3)


def test_sampling_returns_nan_where_disparity_is_unknown() -> None:
    disparity = plane(20, 0, 0)
    disparity[:, 30:] = 35
    disparity[10:20, :10] = np.nan
    places = {
        (29.5, 5.0): np.nan,  # between two surfaces
        (28.5, 5.0): 20.0,
        (30.5, 5.0): 35.0,
        (5.0, 15.0): np.nan,  # a hole
        (9.4, 15.0): np.nan,  # mostly hole
        (9.6, 15.0): 20.0,  # mostly known
        (-0.1, 5.0): np.nan,  # outside
        (59.1, 5.0): np.nan,
        (np.nan, 5.0): np.nan,
        (59.0, 39.0): 35.0,  # the last pixel
    }
    found = sample_disparity(disparity, np.array(list(places), np.float32))
    np.testing.assert_allclose(found, list(places.values()))
    assert sample_disparity(disparity, np.empty((0, 2), np.float32)).shape == (0,)


def test_cloud_has_the_colours_and_positions_of_its_pixels() -> None:
    disparity = np.full((256, 512), np.nan, np.float32)
    disparity[100:120, 200:240] = 20.0
    image = np.zeros((256, 512, 3), np.uint8)
    image[..., 0], image[..., 2] = 10, 200  # BGR
    points, colors = point_cloud(disparity, image, CAMERA, StereoParameters(), 10_000)
    assert points.shape == (800, 3)
    assert points.dtype == np.float32
    assert (colors == (200, 0, 10)).all()
    px, d = CAMERA.project(points)
    np.testing.assert_allclose(d, 20.0, rtol=1e-5)
    assert (np.rint(px).min(axis=0) == (200, 100)).all()
    assert (np.rint(px).max(axis=0) == (239, 119)).all()
    grey_points, grey = point_cloud(disparity, image[..., 2], CAMERA, StereoParameters(), 10_000)
    np.testing.assert_array_equal(grey_points, points)
    assert (grey == 200).all()


@pytest.mark.parametrize("most", [1, 10, 500, 799])
def test_cloud_respects_its_size_limit_and_covers_the_area(most: int) -> None:
    disparity = np.full((256, 512), np.nan, np.float32)
    disparity[100:120, 200:240] = 20.0
    image = np.zeros((256, 512), np.uint8)
    points, colors = point_cloud(disparity, image, CAMERA, StereoParameters(), most)
    assert len(points) == len(colors) <= most
    if most >= 10:
        assert len(points) >= most / 4
        assert np.ptp(CAMERA.project(points)[0][:, 1]) >= 8


def test_cloud_excludes_points_too_near_or_too_far() -> None:
    disparity = np.full((256, 512), 20.0, np.float32)  # 2.66 m
    image = np.zeros((256, 512), np.uint8)
    for limits in ({"max_depth_m": 2.5}, {"min_depth_m": 2.8}):
        points, _ = point_cloud(disparity, image, CAMERA, StereoParameters(**limits), 1000)
        assert points.shape == (0, 3)
