"""Faults of single images: exposure, covered lens, frozen camera."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from observer.parameters import FeaturesParameters, StereoParameters
from observer.vision.features import detect_features
from observer.vision.image_checks import exposure_reason, frozen_reason
from observer.vision.image_health import ImageHealth
from observer.vision.mismatch import mismatch_reason
from observer.vision.stereo import disparity_map, sample_disparity
from observer.vision.view import StereoRows, View

from .image_pairs import Pair, noisy, scene, with_gamma


def scaled(image: np.ndarray, gain: float) -> np.ndarray:
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


@pytest.mark.parametrize(
    ("fault", "reported"),
    [
        (lambda image: scaled(image, 1.5), "right image is 1.6 times"),
        (lambda image: scaled(image, 0.6), "left image is 1.6 times"),
        (lambda image: with_gamma(image, 0.45), "right image is 1"),
        (lambda image: with_gamma(image, 1.8), "left image is"),
        (lambda image: noisy(np.zeros_like(image)), "right image is black"),
        (lambda image: np.full_like(image, 255), "right image is overexposed"),
        (lambda image: noisy(np.full_like(image, 90)), "right image is without any contrast"),
        (lambda image: cv2.GaussianBlur(image, (0, 0), 12), "right image has only"),
    ],
    ids=["brighter", "darker", "gamma up", "gamma down", "black", "white", "covered", "blurred"],
)
def test_fault_of_one_image_is_reported(
    pair: Pair, fault: Callable[[np.ndarray], np.ndarray], reported: str
) -> None:
    # Dark enough that brightening it saturates nothing.
    left, right = (scaled(image, 0.6) for image in pair)
    assert reported in (exposure_reason(left, fault(right)) or "")
    mirrored = reported.replace("right", "?").replace("left", "right").replace("?", "left")
    if "times" not in reported:
        assert mirrored in (exposure_reason(fault(left), right) or "")


@pytest.mark.parametrize("share", [0.6, 0.8, 1.0])
def test_light_through_fingers_counts_as_a_covered_lens(pair: Pair, share: float) -> None:
    left, right = pair
    glow = np.linspace(20, 120, right.size).reshape(right.shape)
    covered = right.copy()
    columns = int(share * right.shape[1])
    covered[:, :columns] = noisy(glow)[:, :columns]
    assert exposure_reason(left, covered) is not None


@pytest.mark.parametrize(
    ("gain", "share", "reported"),
    [(1.0, 0.8, False), (1.5, 0.8, True), (1.0, 0.4, True)],
    ids=["equal cameras", "unequal cameras", "little matched"],
)
def test_exposure_warning_ignores_a_close_person_if_matches_agree(
    pair: Pair, gain: float, share: float, reported: bool
) -> None:
    left, right = (scaled(image, 0.6) for image in pair)
    found = detect_features(left, FeaturesParameters(max_count=300)).px
    disparity = sample_disparity(disparity_map(left, right, StereoParameters()), found)
    px = found.astype(np.float64)
    # A person in light clothes, close to the right camera only, fills half of its image.
    half = right.shape[1] // 2
    close = scaled(right, gain)
    body = 160 + 6 * np.sin(np.arange(half) / 9.0) * np.ones((len(right), 1))
    close[:, :half] = noisy(gain * body, 1.0)
    disparity[px[:, 0] - disparity < half] = np.nan
    zeros = np.zeros(len(px))
    rows = StereoRows(px, zeros, disparity.astype(np.float64), zeros.astype(np.int64))
    view = View(0, 0.0, None, left, close)
    assert "times as bright" in (exposure_reason(left, close) or "")
    reasons = ImageHealth(scene("lab")[0]).look(view, StereoParameters(), share, rows)
    assert any("times as bright" in reason for reason in reasons) == reported


def test_two_black_images_give_one_reason(pair: Pair) -> None:
    dark = noisy(np.zeros_like(pair[0]), 2.0)
    assert (exposure_reason(dark, dark) or "").startswith("both images are black")


@pytest.mark.parametrize("gain", [0.6, 1.4])
def test_brightness_change_in_both_images_is_not_a_fault(pair: Pair, gain: float) -> None:
    assert exposure_reason(scaled(pair[0], gain), scaled(pair[1], gain)) is None


def test_images_of_any_size_can_be_judged() -> None:
    rng = np.random.default_rng(0)
    for shape in ((8, 8), (17, 33), (375, 1242), (1024, 1280)):
        image = rng.integers(30, 220, shape).astype(np.uint8)
        assert exposure_reason(image, image) is None
        assert mismatch_reason(image, image, 96) is None


def test_frozen_camera_is_reported_until_one_pixel_changes(pair: Pair) -> None:
    left, right = pair
    next_left, next_right = scene("lateral")[1][1]
    assert frozen_reason(left, right, next_left, next_right) is None
    assert "the right image is" in (frozen_reason(left, right, next_left, right.copy()) or "")
    assert "the left image is" in (frozen_reason(left, right, left.copy(), next_right) or "")
    assert "both images are" in (frozen_reason(left, right, left, right) or "")
    touched = right.copy()
    touched[200, 300] ^= 1
    assert frozen_reason(left, right, next_left, touched) is None


def test_stationary_camera_at_a_static_scene_is_not_frozen(pair: Pair) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        before, now = (
            [np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
             for image in pair]
            for _ in range(2)
        )  # fmt: skip
        assert frozen_reason(*before, *now) is None
