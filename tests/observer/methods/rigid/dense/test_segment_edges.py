"""Edges of segments: what cuts them off, their windows and boxes."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.methods.rigid.dense.segments import box_px, segment_of, window_of

from ..solid_worlds import ALL, CAMERA, GRID, WALL, cells, on_floor, person
from .segmented_worlds import window_mask, world

quick = settings(max_examples=10)


def test_no_side_is_cut_in_the_open() -> None:
    scene = world(person(0.2, 4.0))
    segment = segment_of(scene, cells(scene, person(0.2, 4.0)))
    assert segment.cut == (False, False, False, False)
    left, top, right, bottom = segment.box
    assert segment.mask[top:bottom, left:right].sum() == segment.area
    assert segment.columns == pytest.approx((left, (left + right - 1) / 2, right - 1), abs=0.6)


@pytest.mark.parametrize(("side", "x"), [(0, -2.45), (1, 2.55)])
def test_the_image_border_cuts_the_side_at_it(side: int, x: float) -> None:
    newcomer = person(x, 4.0)
    scene = world(arrived=[newcomer])
    cut = segment_of(scene, cells(scene, newcomer)).cut
    assert cut[side]
    assert not cut[1 - side]


def test_the_border_of_the_right_image_cuts_the_left_side() -> None:
    """It does not see the left camera's first columns."""
    newcomer = person(0.0, 4.0)
    scene = world(arrived=[newcomer])
    first = int(60.0 / 3.875 / GRID.reduction)
    mask = window_mask(60, 120, first, first + 25)
    scene.disparity[mask] = 60.0 / 3.875
    assert segment_of(scene, mask).cut[:2] == (True, False)


@pytest.mark.parametrize(("side", "x"), [(0, -0.35), (1, 0.55)])
def test_a_nearer_object_cuts_the_side_it_hides(side: int, x: float) -> None:
    newcomer, pillar = person(0.2, 4.0), on_floor(x * 0.6, 2.4, (0.4, 2.0, 0.2))
    scene = world(pillar, arrived=[newcomer])
    cut = segment_of(scene, cells(scene, newcomer, pillar)).cut
    assert cut[side]
    assert not cut[1 - side]


def test_a_farther_object_cuts_nothing() -> None:
    newcomer, pillar = person(0.2, 3.0), on_floor(0.8, 5.0, (0.4, 2.0, 0.2))
    scene = world(pillar, arrived=[newcomer])
    assert segment_of(scene, cells(scene, newcomer, pillar)).cut[:2] == (False, False)


def test_head_and_feet_are_cut_near_the_camera() -> None:
    tall = on_floor(0.0, 1.8, (0.45, 1.9, 0.25))
    scene = world(arrived=[tall])
    mask = window_mask(0, GRID.height, 140, 180)
    scene.disparity[mask] = 35.0
    assert segment_of(scene, mask).cut[2:] == (True, True)


@quick
@given(
    top=st.integers(0, 190), left=st.integers(0, 300), h=st.integers(1, 40), w=st.integers(1, 40)
)
def test_a_window_is_the_bounding_box_of_its_mask(top: int, left: int, h: int, w: int) -> None:
    mask = window_mask(top, top + h, left, left + w)
    assert mask[window_of(mask)].all()
    assert mask[window_of(mask)].sum() == mask.sum()
    wide = window_of(mask, 5)
    assert wide[0].start == max(0, top - 5)
    assert wide[1].stop == min(GRID.width, min(GRID.width, left + w) + 5)


def test_an_empty_mask_has_an_empty_window() -> None:
    assert window_mask(0, 0, 0, 0)[window_of(window_mask(0, 0, 0, 0))].size == 0


def test_the_pixel_box_reaches_the_outer_edges_of_the_cells() -> None:
    scene = world(WALL)
    u0, v0, u1, v1 = box_px(GRID, segment_of(scene, window_mask(20, 60, 100, 130)))
    assert (u0, v0, u1, v1) == (199.5, 39.5, 259.5, 119.5)
    whole = box_px(GRID, segment_of(scene, ALL))
    assert whole == (-0.5, -0.5, CAMERA.width - 0.5, CAMERA.height - 0.5)
