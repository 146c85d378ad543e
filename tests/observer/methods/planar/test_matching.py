"""Matching by descriptors and by tracking, against a known shift of the image."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.methods.planar.matching import match_descriptors, track_features
from observer.parameters import FeaturesParameters, FlowParameters, MatchingParameters
from observer.types import Matches
from observer.vision.features import Features, detect_features

DETECTORS = ["fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb", "surf"]
SHIFT = np.array([7.0, -4.0])


@pytest.fixture(scope="module")
def pair() -> tuple[np.ndarray, np.ndarray]:
    """The second image is the first shifted by SHIFT, with independent noise."""
    rng = np.random.default_rng(5)
    noise = rng.integers(0, 256, (300, 560)).astype(np.uint8)
    scene = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    u, v = SHIFT.astype(int)
    views = (scene[20:276, 20:532], scene[20 - v : 276 - v, 20 - u : 532 - u])
    first, second = (
        np.clip(view + rng.normal(0, 2, view.shape), 0, 255).astype(np.uint8) for view in views
    )
    return first, second


def right(matches: Matches) -> np.ndarray:
    return np.linalg.norm(matches.current - matches.previous - SHIFT, axis=1) <= 1.5


@pytest.mark.parametrize("detector", DETECTORS)
def test_descriptors_find_the_shift(pair: tuple[np.ndarray, np.ndarray], detector: str) -> None:
    parameters = FeaturesParameters(detector=detector, max_count=400)
    first, second = (detect_features(image, parameters) for image in pair)
    matches = match_descriptors(*pair, first, second, MatchingParameters())
    assert len(matches) >= 30
    assert right(matches).mean() >= 0.9


@pytest.mark.parametrize("detector", DETECTORS)
def test_tracking_finds_the_shift(pair: tuple[np.ndarray, np.ndarray], detector: str) -> None:
    first = detect_features(pair[0], FeaturesParameters(detector=detector, max_count=400))
    matches = track_features(*pair, first, MatchingParameters(), FlowParameters())
    assert len(matches) >= 30
    assert right(matches).mean() >= 0.95


def test_ratio_and_cross_check_reject_ambiguous_matches(
    pair: tuple[np.ndarray, np.ndarray],
) -> None:
    first, second = (detect_features(image, FeaturesParameters()) for image in pair)
    strict = match_descriptors(*pair, first, second, MatchingParameters(ratio=0.6))
    loose = match_descriptors(
        *pair, first, second, MatchingParameters(ratio=1.0, cross_check=False)
    )
    assert len(strict) < len(loose)
    assert right(strict).mean() > right(loose).mean()
    # Only the cross check makes matches one to one.
    assert len(np.unique(strict.current, axis=0)) == len(strict)
    assert len(np.unique(loose.current, axis=0)) < len(loose)


def test_a_repeated_pattern_has_hardly_any_match_by_ratio() -> None:
    tile = np.random.default_rng(0).integers(0, 256, (32, 32)).astype(np.uint8)
    image = np.tile(cv2.GaussianBlur(tile, (0, 0), 1.5), (8, 16)).astype(np.uint8)
    features = detect_features(image, FeaturesParameters(fast_threshold=5))
    assert len(features) > 50
    none = match_descriptors(image, image, features, features, MatchingParameters(ratio=0.9))
    assert len(none) < 0.1 * len(features)


@pytest.mark.parametrize("method", ["descriptor", "klt"])
def test_matches_that_move_too_far_are_rejected(
    pair: tuple[np.ndarray, np.ndarray], method: str
) -> None:
    parameters = MatchingParameters(max_shift=0.01)
    first, second = (detect_features(image, FeaturesParameters()) for image in pair)
    if method == "klt":
        matches = track_features(*pair, first, parameters, FlowParameters())
    else:
        matches = match_descriptors(*pair, first, second, parameters)
    assert (np.linalg.norm(matches.current - matches.previous, axis=1) <= 5.12).all()
    assert not right(matches).any()


def test_the_back_check_rejects_points_that_become_covered(
    pair: tuple[np.ndarray, np.ndarray],
) -> None:
    first, second = pair
    covered = second.copy()
    covered[:, 200:300] = np.random.default_rng(1).integers(0, 256, (256, 100))
    features = detect_features(first, FeaturesParameters())
    generous = FlowParameters(max_error=100.0)
    checked = track_features(first, covered, features, MatchingParameters(), generous)
    unchecked = track_features(
        first, covered, features, MatchingParameters(cross_check=False), generous
    )
    assert len(checked) < len(unchecked)
    assert right(checked).mean() > right(unchecked).mean()


@pytest.mark.parametrize("detector", DETECTORS)
def test_nothing_to_match_gives_no_matches(
    pair: tuple[np.ndarray, np.ndarray], detector: str
) -> None:
    nothing = Features(np.empty((0, 2), np.float32), None, detector)
    some = detect_features(pair[0], FeaturesParameters(detector=detector))
    for a, b in ((nothing, some), (some, nothing), (nothing, nothing)):
        assert len(match_descriptors(*pair, a, b, MatchingParameters())) == 0
    tracked = track_features(*pair, nothing, MatchingParameters(), FlowParameters())
    assert len(tracked) == 0
