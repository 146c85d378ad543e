"""People of whom only a part moves, or seems to, still get whole segments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.people import whole_person, with_head
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, segment_of

from ..solid_worlds import (
    ALL,
    HERE,
    ROOM,
    Shape,
    Solid,
    cells,
    on_floor,
    overlap,
    person,
    seen,
)

# --- an arm of a static person -------------------------------------------------------------

ARM = Solid((0.3, -0.4, 4.0), (0.2, 0.25, 0.2))


def with_arm(body: Shape, *arrived: Shape) -> tuple[DenseScene, Segment]:
    """A body with an arm beside it; the cells of ``arrived`` are new, the rest is static."""
    scene = seen([*ROOM, body, ARM])
    evidence = np.where(scene.standing, STATIC, 0).astype(np.uint8)
    for shape in arrived:
        evidence[cells(scene, shape)] = ARRIVED
    scene = seen([*ROOM, body, ARM], HERE, evidence)
    return scene, segment_of(scene, cells(scene, ARM))


def test_an_arm_of_a_standing_person_starts_as_the_whole_person() -> None:
    who = person(0.0, 4.0)
    scene, arm = with_arm(who, ARM)
    assert overlap(whole_person(scene, arm, ALL).mask, cells(scene, who) | arm.mask) > 0.9


def test_an_arm_of_a_walking_person_stays_a_separate_segment() -> None:
    who = person(0.0, 4.0)
    scene, arm = with_arm(who, ARM, who)
    assert whole_person(scene, arm, ALL) is arm


def test_an_object_moving_beside_a_cabinet_is_not_an_arm() -> None:
    scene, thing = with_arm(on_floor(0.0, 4.0, (1.8, 1.0, 0.3)), ARM)
    assert whole_person(scene, thing, ALL) is thing


@pytest.mark.parametrize(("height_m", "alone"), [(0.4, True), (0.9, False)])
def test_a_robot_passing_something_as_high_as_a_person_is_not_its_limb(
    height_m: float, alone: bool
) -> None:
    """Seen at the same depth. A leg that steps forward is narrower, or higher."""
    robot = on_floor(0.35, 4.0, (0.4, height_m, 0.3))
    post = on_floor(0.0, 4.0, (0.5, 1.9, 0.3))
    scene = seen([*ROOM, post, robot])
    evidence = np.where(scene.standing, STATIC, 0).astype(np.uint8)
    mask = cells(scene, robot)
    evidence[mask] = ARRIVED
    scene = seen([*ROOM, post, robot], HERE, evidence)
    part = segment_of(scene, mask)
    assert (whole_person(scene, part, ALL) is part) is alone


# --- head and shoulders ----------------------------------------------------------------------

# Walks in plain clothes past a plain wall, so that only the part below the shoulders moves.
TALL = Solid((0.0, 0.1, 4.0), (0.45, 1.8, 0.25))
SHOULDERS_M = 0.5


def walking(*others: Shape, who: Solid = TALL) -> tuple[DenseScene, Segment]:
    """Somebody in a room, and the segment of the part that moves; the rest seems static."""
    scene = seen([*ROOM, who, *others])
    (x, y, z), (width, height, depth) = who.centre, who.size
    below = Solid((x, y + SHOULDERS_M / 2, z), (width, height - SHOULDERS_M, depth))
    return scene, segment_of(scene, cells(scene, below, *others))


def test_seemingly_static_head_and_shoulders_belong_to_a_walking_person() -> None:
    scene, part = walking()
    assert overlap(part.mask, cells(scene, TALL)) < 0.8
    assert overlap(with_head(scene, part, ALL).mask, cells(scene, TALL)) > 0.95


def test_a_wide_object_above_a_walking_person_is_not_a_head() -> None:
    cupboard = Solid((0.0, -1.1, 4.0), (2.5, 0.6, 0.25))
    scene, part = walking(cupboard)
    assert with_head(scene, part, ALL) is part


def test_cells_that_are_not_free_are_not_added() -> None:
    scene, part = walking()
    assert with_head(scene, part, part.mask) is part


def test_no_head_is_searched_above_the_image_or_on_a_whole_person() -> None:
    scene, part = walking()
    whole = with_head(scene, part, ALL)
    assert with_head(scene, whole, ALL) is whole
    cut = replace(part, cut=(False, False, True, False))
    assert with_head(scene, cut, ALL) is cut


def test_a_person_is_limited_to_human_height() -> None:
    """A narrow thing reaches up to the ceiling."""
    post = Solid((0.0, -0.5, 4.0), (0.45, 3.0, 0.25))
    scene, part = walking(who=post)
    whole = with_head(scene, part, ALL)
    height_m = (whole.box[3] - whole.box[1]) / scene.grid.per_metre(whole.disparity)
    assert height_m == pytest.approx(2.4, abs=0.1)


def test_no_head_is_searched_when_the_camera_may_look_down() -> None:
    scene, part = walking()
    tilted = GroundPlane(np.array([0.0, 0.8, 0.6]), 1.0)
    for ground in (None, tilted):
        assert with_head(replace(scene, ground=ground), part, ALL) is part
