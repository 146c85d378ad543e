"""Segments of worlds whose things and their motions are known cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import (
    Expected,
    Segment,
    box_px,
    followed_segment,
    fresh_segments,
    is_small,
    owners,
    segment_of,
    window_of,
)

from ..solid_worlds import (
    ALL,
    CAMERA,
    FLOOR,
    GRID,
    HERE,
    ROOM,
    WALL,
    Plane,
    Shape,
    Solid,
    cells,
    cells_of,
    disparity_of,
    on_floor,
    overlap,
    person,
    seen,
)

Mask = NDArray[np.bool_]
quick = settings(deadline=None, max_examples=10)


def world(
    *things: Shape, arrived: Sequence[Shape] = (), uncovered: Sequence[Shape] = ()
) -> DenseScene:
    """A room with things, including those that arrived and those that were uncovered."""
    shapes = [*ROOM, *things, *arrived, *uncovered]
    evidence = np.full(GRID.shape, STATIC, np.uint8)
    for what, kind in ((arrived, ARRIVED), (uncovered, UNCOVERED)):
        for shape in what:
            evidence[cells_of(shape, shapes)] = kind
    bare = seen(shapes)
    evidence[~bare.standing] = 0
    return seen(shapes, HERE, evidence)


def only(scene: DenseScene) -> Segment:
    (segment,) = fresh_segments(scene, ALL)
    return segment


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


def ball(x: float, z: float, size: float = 0.25) -> Solid:
    return on_floor(x, z, (size, size, size))


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


# --- what cuts it off ----------------------------------------------------------------------


def window_mask(top: int, bottom: int, left: int, right: int) -> Mask:
    mask = np.zeros(GRID.shape, np.bool_)
    mask[top:bottom, left:right] = True
    return mask


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


# --- following -----------------------------------------------------------------------------


def expected_at(thing: Shape) -> Expected:
    disparity = disparity_of([thing])
    return Expected(np.isfinite(disparity), float(np.nanmedian(disparity)))


def followed(scene: DenseScene, where: Expected, free: Mask = ALL, grows: bool = True) -> Segment:
    core = owners(scene, [where]) == 0
    segment = followed_segment(scene, where, core, free, grows=grows, small=False)
    assert segment is not None
    return segment


@quick
@given(dx=st.floats(-0.06, 0.06), dz=st.floats(-0.1, 0.1))
def test_a_body_is_found_near_its_expected_position(dx: float, dz: float) -> None:
    now = person(0.2 + dx, 4.0 + dz)
    scene = world(arrived=[now])
    segment = followed(scene, expected_at(person(0.2, 4.0)))
    assert overlap(segment.mask, cells(scene, now)) > 0.9


def test_a_body_that_stopped_long_ago_is_still_found() -> None:
    newcomer = person(0.2, 4.0)
    scene = world(newcomer)
    segment = followed(scene, expected_at(newcomer), grows=False)
    assert segment.static == 1.0
    assert overlap(segment.mask, cells(scene, newcomer)) > 0.95


def test_a_stopped_body_does_not_grow_over_a_crate_placed_beside_it() -> None:
    newcomer, crate = person(0.0, 4.0), on_floor(0.525, 4.0, (0.6, 0.9, 0.25))
    scene = world(newcomer, arrived=[crate])
    on_crate = cells(scene, crate, newcomer) & ~expected_at(newcomer).mask
    stopped = followed(scene, expected_at(newcomer), grows=False)
    assert not (stopped.mask & on_crate).any()
    # the segment of a moving body may grow onto it
    assert (followed(scene, expected_at(newcomer)).mask & on_crate).any()


def test_only_a_small_body_is_followed_as_a_small_segment() -> None:
    now = ball(0.4, 3.0, 0.17)
    scene, where = world(arrived=[now]), expected_at(now)
    core = owners(scene, [where]) == 0
    assert followed_segment(scene, where, core, ALL, grows=True, small=False) is None
    segment = followed_segment(scene, where, core, ALL, grows=True, small=True)
    assert segment is not None
    assert overlap(segment.mask, cells(scene, now)) > 0.9


def test_nothing_is_found_where_a_body_is_gone() -> None:
    where = expected_at(person(0.2, 4.0))
    scene = world()
    core = owners(scene, [where]) == 0
    assert followed_segment(scene, where, core, ALL, grows=True, small=False) is None


def test_a_body_takes_only_free_cells() -> None:
    newcomer = person(0.2, 4.0)
    scene = world(arrived=[newcomer])
    free = ALL.copy()
    free[:, 180:] = False
    assert not followed(scene, expected_at(newcomer), free).mask[:, 180:].any()


@pytest.mark.parametrize("z", [(4.0, 2.8), (2.8, 4.0)])
def test_cells_of_two_crossing_bodies_are_assigned_by_depth(z: tuple[float, float]) -> None:
    """Both are expected at the same cells; the nearer one hides the other."""
    one, other = person(0.1, z[0]), person(0.0, z[1])
    scene = world(arrived=[one, other])
    owner = owners(scene, [expected_at(one), expected_at(other)])
    # Only standing cells count: near their feet neither stands out.
    assert (owner[cells(scene, one, other)] == 0).all()
    assert (owner[cells(scene, other, one)] == 1).all()


def test_cells_far_from_any_expected_depth_or_position_are_unassigned() -> None:
    newcomer, stranger = person(0.1, 4.0), person(0.0, 2.0)
    scene = world(arrived=[newcomer, stranger])
    owner = owners(scene, [expected_at(newcomer)])
    assert (owner[cells(scene, stranger, newcomer)] == -1).all()
    assert (owner[~expected_at(newcomer).mask] == -1).all()
    assert (owners(scene, []) == -1).all()


# --- geometry ------------------------------------------------------------------------------


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
