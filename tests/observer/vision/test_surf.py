"""SURF from the optional extra: positions, descriptors, and the refusal if it is missing."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from observer.errors import InputError, ParameterError
from observer.parameters import FeaturesParameters, Parameters
from observer.parameters.surf_extra import surf_missing
from observer.vision.features import detect_features
from observer.vision.surf import surf_descriptors, surf_points

BRIGHT, DARK = (300, 90), (120, 180)
HOW_TO_GET_IT = "pip install 'dynamic-observer\\[surf\\]'"


@pytest.fixture
def blobs() -> np.ndarray:
    """A bright and a dark blob, each at (u, v) with very different u and v."""
    image = np.full((256, 512), 128, np.uint8)
    cv2.circle(image, BRIGHT, 6, 230, -1)
    cv2.circle(image, DARK, 6, 20, -1)
    return cv2.GaussianBlur(image, (0, 0), 1.5)


@pytest.fixture
def without_mahotas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mahotas", None)


def test_blob_is_found_at_its_position(blobs: np.ndarray) -> None:
    strongest = surf_points(blobs, 1000)[:2]
    found = {point.class_id: np.array(point.pt) for point in strongest}
    np.testing.assert_allclose(found[-1], BRIGHT, atol=0.2)
    np.testing.assert_allclose(found[1], DARK, atol=0.2)
    # The same through the stage: x is u, and the points keep the order of the keypoints.
    features = detect_features(blobs, FeaturesParameters(detector="surf"))
    assert np.linalg.norm(features.px - BRIGHT, axis=1).min() < 0.2
    assert features.keypoints is not None
    np.testing.assert_allclose(features.px, [point.pt for point in features.keypoints])


@pytest.mark.parametrize("radius", [5, 9, 14])
def test_keypoint_size_grows_with_the_blob(radius: int) -> None:
    image = np.full((256, 256), 128, np.uint8)
    cv2.circle(image, (100, 140), radius, 230, -1)
    strongest = surf_points(np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8), 1000)[0]
    np.testing.assert_allclose(strongest.pt, (100, 140), atol=0.5)
    # The filter is about twice as wide as the disc with the strongest response.
    assert strongest.size == pytest.approx(1.9 * 2 * radius, rel=0.2)


def test_only_the_strongest_are_returned() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (256, 512)).astype(np.uint8)
    image = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2), np.uint8)
    every, some = surf_points(image, 100_000), surf_points(image, 50)
    assert len(every) > 200
    assert [p.response for p in some] == sorted((p.response for p in every), reverse=True)[:50]


def test_descriptors_are_unit_vectors_of_64_values_at_their_points(
    blobs: np.ndarray,
) -> None:
    points = surf_points(blobs, 1000)
    px, values = surf_descriptors(blobs, points)
    assert 2 <= len(px) == len(values)
    assert values.shape[1] == 64
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, atol=1e-6)
    known = np.array([p.pt for p in points])
    assert (np.linalg.norm(px[:, None] - known[None], axis=2).min(axis=1) < 1e-3).all()


def test_no_points_have_no_descriptors(blobs: np.ndarray) -> None:
    px, values = surf_descriptors(blobs, ())
    assert px.shape == (0, 2)
    assert values.shape == (0, 64)


@pytest.mark.usefixtures("without_mahotas")
def test_surf_is_refused_without_the_extra(blobs: np.ndarray) -> None:
    assert surf_missing() is not None
    with pytest.raises(ParameterError, match=HOW_TO_GET_IT) as refused:
        Parameters().changed({"features.detector": "surf", "features.max_count": 100})
    assert list(refused.value.problems) == ["features.detector"]
    assert Parameters().changed({"features.detector": "kaze"}).features.detector == "kaze"
    with pytest.raises(InputError, match=HOW_TO_GET_IT):
        detect_features(blobs, FeaturesParameters(detector="surf"))


def test_surf_can_be_chosen_with_the_extra() -> None:
    assert surf_missing() is None
    assert Parameters().changed({"features.detector": "surf"}).features.detector == "surf"
