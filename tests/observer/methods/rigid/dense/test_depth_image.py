"""Disparity of pairs generated from it: right where there is texture, unknown elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from observer.methods.rigid.dense.depth_image import (
    RowTexture,
    depth_image,
    least_step,
    noise_of,
    textured,
)
from observer.methods.rigid.dense.grid import Grid
from observer.parameters import StereoParameters
from observer.types import Image

from ....builders import Texture, as_image
from ..solid_worlds import CAMERA, GRID

quick = settings(max_examples=10)
P = StereoParameters()
SHAPE = (CAMERA.height, CAMERA.width)
# If texture were as fine as a cell everywhere, it would count as noise.
PAPER = Texture(1, SHAPE, finest_px=12.0)
OTHER = Texture(2, SHAPE, finest_px=12.0)


def pair_at(disparity: float, noise: float = 1.0) -> tuple[Image, Image]:
    """A textured wall, straight ahead."""
    return as_image(PAPER.moved(), noise, 1), as_image(PAPER.moved(-disparity), noise, 2)


def depth_of(left: Image, right: Image) -> NDArray[np.float32]:
    small = GRID.reduced(left)
    return depth_image(small, GRID.reduced(right), RowTexture.of(small), GRID, P)


@pytest.mark.parametrize("disparity", [5.0, 12.5, 31.0, 50.3])
def test_the_disparity_of_a_textured_wall_is_in_full_image_pixels(disparity: float) -> None:
    found = depth_of(*pair_at(disparity))
    assert found.shape == GRID.shape
    beside = found[:, round(disparity / GRID.reduction) + 3 :]
    assert np.isfinite(beside).mean() > 0.95
    assert np.nanmedian(np.abs(beside - disparity)) < 0.4
    assert np.nanquantile(np.abs(beside - disparity), 0.98) < 1.3


def test_the_area_outside_the_right_image_is_unknown() -> None:
    """Left of its image's border. The texture is periodic, so there is no false match there."""
    found = depth_of(*pair_at(40.0))
    assert not (found[:, :18] > 2 * np.arange(18) + 2).any()


def test_an_object_in_front_of_a_wall_has_its_own_disparity() -> None:
    left, right = pair_at(10.0)
    thing = as_image(OTHER.moved(), 1.0, 3)
    left[120:300, 250:400] = thing[120:300, 250:400]
    right[120:300, 220:370] = thing[120:300, 250:400]
    found = depth_of(left, right)
    assert np.nanmedian(found[65:145, 130:195]) == pytest.approx(30.0, abs=0.4)
    assert np.nanmedian(found[:50]) == pytest.approx(10.0, abs=0.4)


def test_a_blank_wall_gives_no_depth() -> None:
    blank = np.full(SHAPE, 120.0)
    left, right = as_image(blank, 2.0, 1, mean=0.0), as_image(blank, 2.0, 2, mean=0.0)
    assert np.isfinite(depth_of(left, right)).mean() < 0.01


def test_no_depth_is_invented_far_from_texture() -> None:
    left, right = pair_at(20.0)
    left[:, 200:480] = right[:, 180:460] = 120
    found = depth_of(left, right)
    assert not np.isfinite(found[:, 115:225]).any()
    assert np.isfinite(found[:, 260:]).mean() > 0.9


def test_the_same_pair_gives_identical_depth() -> None:
    pair = pair_at(20.0)
    np.testing.assert_array_equal(depth_of(*pair), depth_of(*pair))


@quick
@given(sigma=st.floats(1.5, 12.0), seed=st.integers(0, 999))
def test_noise_of_a_plain_image_is_estimated(sigma: float, seed: int) -> None:
    image = as_image(np.zeros((200, 320)), sigma, seed)
    assert noise_of(image) == pytest.approx(sigma, rel=0.25, abs=0.4)


def test_edges_along_rows_and_columns_are_not_noise() -> None:
    stripes = np.zeros((200, 320))
    stripes[:, 1::2] += 50
    stripes[1::2] += 30
    assert noise_of(as_image(stripes, mean=80.0)) == 0.0


@pytest.mark.parametrize("sigma", [0.0, 3.0, 10.0])
def test_noise_is_not_texture(sigma: float) -> None:
    image = as_image(np.zeros((200, 320)), sigma, 5)
    assert textured(image, least_step(image)).mean() < 0.05


@pytest.mark.parametrize("sigma", [0.0, 3.0])
def test_a_step_counts_as_texture_nearby_on_its_rows(sigma: float) -> None:
    step = np.zeros((200, 320))
    step[50:150, 160:] = 80
    image = as_image(step, sigma, 6, mean=80.0)
    found = textured(image, least_step(image))
    assert found[52:148, 152:168].all()
    assert found[52:148, :140].mean() < 0.05
    assert found[:48].mean() < 0.05


# With so short a baseline pixels are matched.
SHORT = Grid.of(replace(CAMERA, baseline=0.03))


def short_depth_of(left: Image, right: Image) -> NDArray[np.float32]:
    texture = RowTexture.of(SHORT.reduced(left))
    return depth_image(SHORT.matched(left), SHORT.matched(right), texture, SHORT, P)


@pytest.mark.parametrize("disparity", [1.7, 3.2, 5.6])
def test_with_a_short_baseline_disparities_are_known_better_than_to_a_fraction_of_a_cell(
    disparity: float,
) -> None:
    """At 4 m half a pixel is half a metre there."""
    left, right = pair_at(disparity)
    fine = short_depth_of(left, right)
    assert fine.shape == SHORT.shape
    beside = fine[:, round(disparity / SHORT.reduction) + 3 :]
    assert np.isfinite(beside).mean() > 0.95
    assert np.nanquantile(np.abs(beside - disparity), 0.98) < 0.45


def test_a_cell_has_the_disparity_of_what_is_nearest_in_it() -> None:
    """An edge within a cell is no mean of both sides."""
    near, far = 9.0, 3.0
    left, right = as_image(PAPER.moved(), 1.0, 1), as_image(PAPER.moved(-far), 1.0, 2)
    edge = 151
    near_left, near_right = as_image(OTHER.moved(), 1.0, 3), as_image(OTHER.moved(-near), 1.0, 4)
    left[:, edge : edge + 60] = near_left[:, edge : edge + 60]
    begin = edge - round(near)
    right[:, begin : begin + 60] = near_right[:, begin : begin + 60]
    found = short_depth_of(left, right)
    between = np.abs(found - (near + far) / 2) < 1.0
    assert between[np.isfinite(found)].mean() < 0.01


def test_what_is_near_a_short_baseline_keeps_its_disparity() -> None:
    """However short the baseline, all disparities up to the largest are searched."""
    disparity = 90.0
    found = short_depth_of(*pair_at(disparity))
    beside = found[:, round(disparity / SHORT.reduction) + 3 :]
    assert np.isfinite(beside).mean() > 0.9
    assert np.nanmedian(np.abs(beside - disparity)) < 0.6
