"""Segments of bodies that are already known, near where they are expected."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Expected, Segment, followed_segment, owners

from ..solid_worlds import ALL, Shape, cells, disparity_of, on_floor, overlap, person
from .segmented_worlds import Mask, ball, world

quick = settings(max_examples=10)


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
