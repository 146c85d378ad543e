"""The kernel that finds cells of an image in a later one against the same by numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.picture_shift import find_shifted

from .oracles.picture_shift import View

Image = NDArray[np.uint8]
HEIGHT, WIDTH = 60, 90


def pictures(seed: int, shift: Float64Array, contrast: float) -> tuple[Image, Image]:
    """Grey images (h, w) before and after a shift by (2,) cells, with independent noise."""
    rng = np.random.default_rng(seed)
    smooth = cv2.GaussianBlur(rng.normal(0.0, 1.0, (HEIGHT, WIDTH)), (0, 0), 1.5)
    before = 128 + contrast * smooth / smooth.std()
    move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    after = 5 + cv2.warpAffine(before, move, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    noisy = (np.rint(image + rng.normal(0.0, 1.5, image.shape)) for image in (before, after))
    first, second = (np.clip(image, 0, 255).astype(np.uint8) for image in noisy)
    return first, second


def compare(
    view: View,
    after: Image,
    expected: Float64Array,
    standing: Float64Array,
    scale: float,
    reach: int,
) -> bool:
    """Check that kernel and oracle agree; return whether they find anything."""
    wanted = view.found_in(after, expected, standing, scale, reach)
    found, place, cov = find_shifted(view.image, view.at, after, expected, standing, scale, reach)
    assert found == (wanted is not None)
    if wanted is not None:
        np.testing.assert_allclose(place, wanted[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(cov, wanted[1], rtol=1e-7, atol=1e-12)
    return found


@pytest.mark.parametrize("contrast", [0.0, 3.0, 25.0])
@pytest.mark.parametrize("seed", range(10))
def test_the_shift_matches_numpy(seed: int, contrast: float) -> None:
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-3, 3, 2)
    before, after = pictures(seed, shift, contrast)
    # Some reach the border, where gradients are those of a mirrored image.
    left, top = rng.integers(0, WIDTH - 16), rng.integers(0, HEIGHT - 14)
    rows, columns = np.mgrid[top : top + 14, left : left + 16]
    some = rng.random(rows.shape) < 0.8
    view = View(before, np.stack([columns[some], rows[some]]))
    expected = view.middle + shift + rng.normal(0.0, 1.0, 2)
    found = compare(
        view, after, expected, view.middle, float(rng.uniform(0.8, 1.25)), int(rng.integers(0, 4))
    )
    assert found or contrast < 25


@pytest.mark.parametrize("column", [-40.0, -3.0, 1.0, 12.0, WIDTH - 13.0, WIDTH + 2.0])
def test_the_shift_at_the_border_matches_numpy(column: float) -> None:
    before, after = pictures(0, np.zeros(2), 20.0)
    rows, columns = np.mgrid[20:34, 30:46]
    view = View(before, np.stack([columns.ravel(), rows.ravel()]))
    expected = np.array([column, 30.3])
    compare(view, after, expected, np.array([WIDTH * 2.0, 30.0]), 1.0, 2)


def test_the_shift_without_contrast_matches_numpy() -> None:
    plain = np.full((HEIGHT, WIDTH), 90, np.uint8)
    rows, columns = np.mgrid[20:34, 30:46]
    view = View(plain, np.stack([columns.ravel(), rows.ravel()]))
    assert compare(view, plain, view.middle + 0.5, view.middle, 1.0, 1)
