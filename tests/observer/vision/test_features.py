"""Feature points: every detector, spread over the image, the same each time."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.parameters import FeaturesParameters
from observer.vision.features import detect_features, spread, strongest_first

DETECTORS = ["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb", "surf"]


def textured(seed: int = 0, size: tuple[int, int] = (256, 512)) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, size).astype(np.uint8)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX)


@pytest.mark.parametrize("detector", DETECTORS)
def test_every_detector_finds_points_inside_the_image(detector: str) -> None:
    features = detect_features(textured(), FeaturesParameters(detector=detector, max_count=400))
    assert 50 <= len(features) <= 400
    assert features.px.dtype == np.float32
    assert (features.px >= 0).all()
    assert (features.px <= (511, 255)).all()
    assert features.detector == detector
    assert (features.keypoints is not None) == (detector in ("brisk", "kaze", "orb", "surf"))


@pytest.mark.parametrize("detector", DETECTORS)
def test_same_image_gives_the_same_points(detector: str) -> None:
    parameters = FeaturesParameters(detector=detector, max_count=200)
    first, second = (detect_features(textured(1), parameters) for _ in range(2))
    np.testing.assert_array_equal(first.px, second.px)


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("grey", [0, 255])
def test_image_without_texture_gives_no_points(detector: str, grey: int) -> None:
    blank = np.full((256, 512), grey, np.uint8)
    assert len(detect_features(blank, FeaturesParameters(detector=detector))) == 0


@pytest.mark.parametrize("detector", ["fast", "shi_tomasi", "harris"])
def test_corners_are_found_at_their_positions(detector: str) -> None:
    image = np.full((128, 256), 40, np.uint8)
    corners = np.array([[60, 40], [119, 40], [60, 89], [119, 89]])
    image[40:90, 60:120] = 220
    blurred = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8)
    found = detect_features(blurred, FeaturesParameters(detector=detector)).px
    nearest = np.linalg.norm(found[:, None] - corners[None], axis=2).min(axis=0)
    assert (nearest <= 2).all()


def test_textured_image_corner_does_not_take_all_points() -> None:
    image = np.full((256, 512), 100, np.uint8)
    image += (textured(2) // 6).astype(np.uint8)
    image[:128, :128] = textured(3, (128, 128))
    params = FeaturesParameters(detector="fast", max_count=320, fast_threshold=2)
    inside = (detect_features(image, params).px < 128).all(axis=1).mean()
    one_cell = params.model_copy(update={"grid_cells": 1})
    inside_unspread = (detect_features(image, one_cell).px < 128).all(axis=1).mean()
    assert inside < 0.25
    assert inside_unspread > 0.5


def test_strongest_points_of_each_cell_are_selected() -> None:
    px = np.array([[10, 10], [20, 20], [300, 10], [310, 20]], np.float32)
    strength = np.array([1.0, 2.0, 9.0, 8.0], np.float32)
    kept = spread(px, strength, (512, 256), 2, 2)
    assert sorted(kept.tolist()) == [1, 2]


@settings(max_examples=30)
@given(
    count=st.integers(0, 200),
    columns=st.integers(1, 32),
    most=st.integers(1, 300),
    seed=st.integers(0, 1000),
)
def test_spread_selects_each_point_once_up_to_the_limit(
    count: int, columns: int, most: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    px = rng.uniform((0, 0), (511, 255), (count, 2)).astype(np.float32)
    strength = rng.uniform(size=count).astype(np.float32)
    kept = spread(px, strength, (512, 256), columns, most)
    assert len(set(kept.tolist())) == len(kept) <= most
    order = rng.permutation(count)
    shuffled = spread(px[order], strength[order], (512, 256), columns, most)
    assert set(order[shuffled].tolist()) == set(kept.tolist())


@pytest.mark.parametrize("detector", DETECTORS)
def test_points_are_ordered_strongest_first_including_weak_ones(detector: str) -> None:
    image = textured()
    image[:, 256:] = 128 + (image[:, 256:].astype(np.int16) - 128) // 6
    parameters = FeaturesParameters(detector=detector, fast_threshold=4, quality=0.5)
    px = strongest_first(image, parameters, 4000)
    assert np.count_nonzero(px[:, 0] > 260) > 20
    if detector != "mser":  # MSER ranks by size, which contrast does not change.
        assert np.mean(px[:40, 0] < 260) > 0.9
    np.testing.assert_array_equal(px, strongest_first(image, parameters, 4000))
