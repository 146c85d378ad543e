"""Segments of worlds whose things and their motions are known cell by cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.segments import fresh_segments, is_small, segment_of

from ..solid_worlds import (
    ALL,
    FLOOR,
    GRID,
    HERE,
    Plane,
    Solid,
    cells,
    on_floor,
    overlap,
    person,
    seen,
)
from .segmented_worlds import ball, only, window_mask, world

quick = settings(max_examples=10)

# --- what is found -------------------------------------------------------------------------


@quick
@given(x=st.floats(-1.0, 1.0), z=st.floats(2.5, 5.5))
def test_an_arrived_person_is_one_segment(x: float, z: float) -> None:
    newcomer = person(x, z)
    scene = world(arrived=[newcomer])
    segment, true = only(scene), cells(scene, newcomer)
    assert overlap(segment.mask, true) > 0.95
    assert segment.is_separate
    assert (segment.arrived, segment.uncovered, segment.static) == (1.0, 0.0, 0.0)
    assert segment.disparity == pytest.approx(60.0 / (z - 0.125), rel=0.01)
    assert segment.area == segment.mask.sum()


def test_an_uncovered_person_is_a_segment() -> None:
    thing = person(0.4, 4.0)
    segment = only(world(uncovered=[thing]))
    assert segment.uncovered == 1.0
    assert segment.is_separate


def test_a_ball_that_arrived_is_a_small_segment() -> None:
    scene = world(arrived=[ball(0.4, 3.0)])
    segment = only(scene)
    assert is_small(scene, segment)
    assert segment.is_clear_cut


def test_something_small_is_no_segment_if_it_does_not_stand_apart() -> None:
    assert fresh_segments(world(arrived=[ball(0.4, 3.0, 0.12)]), ALL) == []
    beside = on_floor(0.85, 3.0, (0.6, 0.6, 0.25))
    assert fresh_segments(world(beside, arrived=[ball(0.4, 3.0)]), ALL) == []


def test_larger_segments_come_before_small_ones() -> None:
    scene = world(arrived=[ball(-0.6, 2.5), person(0.5, 5.5)])
    assert [is_small(scene, segment) for segment in fresh_segments(scene, ALL)] == [False, True]


def test_static_objects_give_no_segments() -> None:
    assert fresh_segments(world(person(0.0, 4.0), on_floor(-1, 3, (0.5, 0.5, 0.5))), ALL) == []


def test_a_segment_does_not_grow_over_the_static_crate_beside_it() -> None:
    """They touch and are at the same distance."""
    newcomer, crate = person(0.0, 4.0), on_floor(0.525, 4.0, (0.6, 0.9, 0.25))
    scene = world(crate, arrived=[newcomer])
    segment = only(scene)
    on_newcomer, on_crate = cells(scene, newcomer, crate), cells(scene, crate, newcomer)
    assert (segment.mask & on_newcomer).sum() > 0.95 * on_newcomer.sum()
    # 12 cm of it, no more
    assert (segment.mask & on_crate).sum() < 0.25 * on_crate.sum()


def test_a_segment_grows_over_unknown_parts_of_an_object() -> None:
    """Half of it was never seen before."""
    newcomer = person(0.0, 4.0)
    scene = world(arrived=[newcomer])
    unknown = cells(scene, newcomer)
    unknown[: GRID.height // 2] = False
    scene.evidence[unknown] = 0
    assert overlap(only(scene).mask, cells(scene, newcomer)) > 0.95


def test_cells_that_are_not_free_start_no_segment() -> None:
    newcomer = person(0.0, 4.0)
    scene = world(arrived=[newcomer])
    assert fresh_segments(scene, ~cells(scene, newcomer)) == []


def test_small_or_thin_objects_start_no_segment() -> None:
    ball, pole = Solid((0.0, 0.0, 4.0), (0.15, 0.15, 0.15)), Solid((0.6, 0, 4.0), (0.02, 1.5, 0.02))
    assert fresh_segments(world(arrived=[ball, pole]), ALL) == []


def test_two_people_arrived_side_by_side_are_two_segments() -> None:
    scene = world(arrived=[person(0.0, 4.0), person(0.8, 4.0)])
    one, other = fresh_segments(scene, ALL)
    assert not (one.mask & other.mask).any()


def test_of_two_overlapping_people_the_second_is_found_after_the_first() -> None:
    """Their changed cells are connected and form one seed, which belongs to the larger part."""
    near, far = person(0.3, 2.5), person(0.0, 4.0)
    scene = world(arrived=[near, far])
    first = only(scene)
    assert overlap(first.mask, cells(scene, near, far)) > 0.9
    (second,) = fresh_segments(scene, ~first.mask)
    assert overlap(second.mask, cells(scene, far, near)) > 0.9


# --- standing apart ------------------------------------------------------------------------


def test_a_box_in_front_of_a_wall_is_separate() -> None:
    scene = world(person(0.3, 4.0))
    segment = segment_of(scene, cells(scene, person(0.3, 4.0)))
    assert segment.is_separate
    assert segment.apart > 0.95


@pytest.mark.parametrize("slant", [0.0, 0.3, 0.7])
def test_a_band_of_a_slanted_wall_is_not_separate(slant: float) -> None:
    wall = Plane((np.sin(slant), 0.0, np.cos(slant)), 4.0)
    scene = seen([FLOOR, wall])
    band = scene.standing.copy()
    band[:, :140] = band[:, 175:] = False
    assert not segment_of(scene, band).is_separate


@pytest.mark.parametrize("slant", [0.0, 0.5])
def test_a_wall_that_seems_to_have_partly_arrived_gives_no_segment(slant: float) -> None:
    wall = Plane((np.sin(slant), 0.0, np.cos(slant)), 4.0)
    bare = seen([FLOOR, wall])
    evidence = np.where(bare.standing, STATIC, 0).astype(np.uint8)
    evidence[30:100, 140:175] = ARRIVED
    assert fresh_segments(seen([FLOOR, wall], HERE, evidence), ALL) == []


@pytest.mark.parametrize(
    ("share", "arrived", "apart"),
    [(0.1, 0.9, True), (0.02, 0.9, False), (0.1, 0.5, False)],
    ids=["near", "small", "was there"],
)
def test_a_large_near_segment_needs_a_less_clear_border(
    share: float, arrived: float, apart: bool
) -> None:
    """Much of its surroundings is seen by one camera only, so its depth is unknown."""
    scene = world(person(0.3, 4.0))
    segment = segment_of(scene, cells(scene, person(0.3, 4.0)))
    area = int(share * segment.mask.size)
    segment = replace(segment, area=area, arrived=arrived, uncovered=0.0, apart=0.9, clear=0.15)
    assert segment.is_separate is apart


@pytest.mark.parametrize(
    ("share", "uncovered", "apart", "whole"),
    [(0.2, 0.9, 0.9, True), (0.02, 0.9, 0.9, False), (0.2, 0.5, 0.9, False),
     (0.2, 0.9, 0.7, False)],
    ids=["goes away", "small", "hardly moved", "beside a wall that it uncovers"],
)  # fmt: skip
def test_a_receding_near_segment_needs_a_clear_separation(
    share: float, uncovered: float, apart: float, whole: bool
) -> None:
    scene = world(person(0.3, 4.0))
    segment = segment_of(scene, cells(scene, person(0.3, 4.0)))
    area = int(share * segment.mask.size)
    segment = replace(segment, area=area, arrived=0.0, uncovered=uncovered, apart=apart, clear=0.15)
    assert segment.is_separate is whole


def test_an_uncovered_segment_must_be_more_clearly_separate() -> None:
    """Something static is beside it at its depth; a quarter of its border is clear."""
    mask = window_mask(30, 90, 100, 130)
    scene = world()
    scene.disparity[:] = np.nan
    scene.disparity[mask] = 15.0
    scene.disparity[24:30, 80:150] = 10.0
    scene.disparity[90:94, 100:115] = 10.0
    segments = []
    for kind in (ARRIVED, UNCOVERED):
        scene.evidence[mask] = kind
        segments.append(segment_of(scene, mask))
    assert 0.2 < segments[0].clear < 0.35
    assert segments[0].is_separate
    assert not segments[1].is_separate
