"""Both images of t+dt are mapped back into the frame of t."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.geometry import map_pixels
from observer.methods.planar.image_transformation import transform_images

AFFINE = np.array([[1.02, 0.01, 6.0], [-0.01, 1.03, -5.0], [0, 0, 1]])
HOMOGRAPHY = np.array([[1.02, 0.01, 6.0], [-0.01, 1.03, -5.0], [3e-5, -2e-5, 1]])


def smooth(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A scene that can be sampled anywhere, in grey levels."""
    return 128 + 60 * np.sin(u / 17) * np.cos(v / 13) + 40 * np.sin((u + v) / 29)


@pytest.mark.parametrize("H", [AFFINE, HOMOGRAPHY])
def test_the_image_at_t_is_recovered(H: np.ndarray) -> None:
    v, u = np.mgrid[0:256, 0:512].astype(float)
    at_t = smooth(u, v)
    # A point at px in the frame of t is at H px in the frame of t+dt.
    back = map_pixels(np.linalg.inv(H), np.stack([u, v], -1).reshape(-1, 2)).reshape(256, 512, 2)
    later = np.rint(smooth(back[..., 0], back[..., 1])).astype(np.uint8)
    right = cv2.flip(later, 0)
    pair = transform_images(later, right, H)
    assert np.abs(pair.left - at_t)[pair.valid].max() <= 3
    assert pair.valid.mean() > 0.9
    expected_right = transform_images(right, right, H).left
    np.testing.assert_array_equal(pair.right, expected_right)


@pytest.mark.parametrize("H", [AFFINE, HOMOGRAPHY])
def test_the_valid_mask_is_the_area_covered_by_the_image_at_t_dt(H: np.ndarray) -> None:
    white = np.full((256, 512), 200, np.uint8)
    pair = transform_images(white, white, H)
    v, u = np.nonzero(pair.valid)
    source = map_pixels(H, np.stack([u, v], -1))
    assert (source >= -0.05).all()
    assert (source <= (511.05, 255.05)).all()
    outside = map_pixels(H, np.argwhere(~pair.valid)[:, ::-1])
    assert ((outside <= 0.05) | (outside >= (510.95, 254.95))).any(axis=1).all()


def test_the_identity_changes_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 96)).astype(np.uint8)
    pair = transform_images(image, image, np.eye(3))
    np.testing.assert_array_equal(pair.left, image)
    assert pair.valid.all()
