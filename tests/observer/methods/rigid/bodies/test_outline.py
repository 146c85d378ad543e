"""Outlines of bodies whose place, size and visibility are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.drawing import silhouette_mask
from observer.geometry import Pose
from observer.methods.rigid.bodies.outline import (
    Outline,
    anchor_of,
    free_cells,
    measured_anchor,
)
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, extent_m, segment_of

from ..solid_worlds import (
    CAMERA,
    GRID,
    HERE,
    ROOM,
    Shape,
    Solid,
    cells_of,
    disparity_of,
    on_floor,
    seen,
)

quick = settings(max_examples=10)
SIZE = (0.45, 1.2, 0.1)
# Metres: where the image's border cuts through a body 4 m away.
EDGE_M = 4.0 * (CAMERA.width / 2) / CAMERA.fx
small = st.floats(-0.2, 0.2)


def body(x: float, z: float) -> Solid:
    """An upright board that ends above the floor, so that all of it stands out."""
    return Solid((x, 0.0, z), SIZE)


def view(
    thing: Shape, *others: Shape, pose: Pose = HERE, evidence: int = ARRIVED
) -> tuple[DenseScene, Segment]:
    """A thing in a room behind others, and the segment of its visible part."""
    shapes = [*ROOM, thing, *others]
    mask = cells_of(thing, shapes, pose)
    scene = seen(shapes, pose, np.where(mask, evidence, STATIC).astype(np.uint8))
    return scene, segment_of(scene, mask)


def outlined(
    x: float, z: float, pose: Pose = HERE, evidence: int = ARRIVED
) -> tuple[Outline, DenseScene]:
    """An outline that was noted once, with the body's origin at its centre."""
    scene, segment = view(body(x, z), pose=pose, evidence=evidence)
    outline = Outline.of(segment, scene)
    outline.note(segment, np.array([x, 0.0, z]), scene, 0.0)
    return outline, scene


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


# --- where it is seen ----------------------------------------------------------------------


@quick
@given(x=st.floats(-0.8, 0.8), z=st.floats(2.5, 6.0))
def test_the_silhouette_covers_the_visible_solid_within_its_box(x: float, z: float) -> None:
    outline, _ = outlined(x, z)
    assert outline.silhouette is not None
    camera = GRID.camera
    drawn = silhouette_mask(outline.silhouette, (camera.height, camera.width))
    # The board is flat: its front is at one depth, and its image a rectangle.
    front = z - SIZE[2] / 2
    edges, _ = camera.project(
        np.array([[x - SIZE[0] / 2, -SIZE[1] / 2, front], [x + SIZE[0] / 2, SIZE[1] / 2, front]])
    )
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    truth = (edges[0, 0] <= u) & (u <= edges[1, 0]) & (edges[0, 1] <= v) & (v <= edges[1, 1])
    assert overlap(drawn, truth) > 0.85
    corners = np.concatenate(outline.silhouette)
    u0, v0, u1, v1 = outline.box_px
    assert corners.min(axis=0).tolist() == [u0 + 0.5, v0 + 0.5]
    assert corners.max(axis=0).tolist() == [u1 - 0.5, v1 - 0.5]


def test_an_unseen_body_has_no_silhouette() -> None:
    outline, _ = outlined(0.1, 4.0)
    outline.seen = False
    assert outline.silhouette is None


# --- where it is expected ------------------------------------------------------------------


@quick
@given(dx=small, dz=st.floats(-0.5, 0.5), turn=st.floats(-0.1, 0.1), x=small, ahead=small)
def test_a_body_is_expected_at_its_new_position_after_both_moved(
    dx: float, dz: float, turn: float, x: float, ahead: float
) -> None:
    outline, _ = outlined(0.1, 4.0)
    pose = Pose.from_rotvec([0.0, turn, 0.0], [x, 0.0, ahead])
    where = outline.expected(np.array([0.1 + dx, 0.0, 4.0 + dz]), pose.inverse(), GRID)
    assert where is not None
    moved = body(0.1 + dx, 4.0 + dz)
    assert overlap(where.mask, cells_of(moved, [moved], pose)) > 0.85
    truth = float(np.nanmedian(disparity_of([moved], pose)))
    assert where.disparity == pytest.approx(truth, rel=0.02)


def test_the_expected_position_is_unchanged_by_a_new_origin() -> None:
    """For instance, points at its side."""
    outline, _ = outlined(0.1, 4.0)
    outline.offsets["middle"] = np.zeros(3)
    offset = np.array([0.2, 0.1, -0.1])
    outline.move_origin(offset)
    assert not outline.offsets
    where = outline.expected(np.array([0.4, 0.0, 3.8]) + offset, HERE, GRID)
    assert where is not None
    moved = body(0.4, 3.8)
    assert overlap(where.mask, cells_of(moved, [moved], HERE)) > 0.85


@pytest.mark.parametrize(
    "place",
    [
        pytest.param((0.0, 0.0, -2.0), id="behind the camera"),
        pytest.param((9.0, 0.0, 4.0), id="beside the image"),
        pytest.param((0.0, 0.0, 1.5), id="much nearer"),
        pytest.param((0.0, 0.0, 12.0), id="much farther"),
    ],
)
def test_a_body_is_not_expected_out_of_sight_or_at_a_very_different_depth(
    place: tuple[float, float, float],
) -> None:
    outline, _ = outlined(0.0, 4.0)
    assert outline.expected(np.array(place), HERE, GRID) is None


PILLAR = Solid((0.15, 0.0, 2.5), (0.3, 2.5, 0.1))
ORIGIN = np.array([0.1, 0.0, 4.0])


def test_a_body_is_expected_whole_while_briefly_partly_hidden() -> None:
    outline, _ = outlined(0.1, 4.0)
    whole = outline.segment.mask
    scene, part = view(body(0.1, 4.0), PILLAR)
    assert part.area < 0.8 * whole.sum()
    for age in (0.1, 0.5, 0.9):
        outline.note(part, ORIGIN, scene, age)
        where = outline.expected(ORIGIN, HERE, GRID)
        assert overlap(where.mask, whole) > 0.99
        assert outline.segment is part


def test_a_body_partly_hidden_for_long_is_expected_as_visible() -> None:
    outline, _ = outlined(0.1, 4.0)
    scene, part = view(body(0.1, 4.0), PILLAR)
    outline.note(part, ORIGIN, scene, 1.1)
    assert overlap(outline.expected(ORIGIN, HERE, GRID).mask, part.mask) > 0.99


def test_a_body_seen_whole_again_is_expected_whole() -> None:
    scene, part = view(body(0.1, 4.0), PILLAR)
    outline = Outline.of(part, scene)
    outline.note(part, ORIGIN, scene, 0.0)
    scene, whole = view(body(0.1, 4.0))
    outline.note(whole, ORIGIN, scene, 0.1)
    assert overlap(outline.expected(ORIGIN, HERE, GRID).mask, whole.mask) > 0.99


def test_an_emerging_body_is_expected_at_its_largest_visible_extent() -> None:
    """From frame to frame more of it emerges from behind a pillar."""
    scene, part = view(body(0.1, 4.0), PILLAR)
    outline = Outline.of(part, scene)
    outline.note(part, ORIGIN, scene, 0.0)
    aside = Solid((0.2, 0.0, 2.5), (0.3, 2.5, 0.1))
    scene, more = view(body(0.1, 4.0), aside)
    assert anchor_of(more) != "middle"
    assert more.area > 1.1 * part.area
    outline.note(more, ORIGIN, scene, 0.1)
    assert overlap(outline.expected(ORIGIN, HERE, GRID).mask, more.mask) > 0.99


# --- where it is measured ------------------------------------------------------------------


def test_the_anchor_is_on_a_side_that_is_not_cut() -> None:
    pillar_left = Solid((-0.1, 0.0, 2.5), (0.3, 2.5, 0.1))
    assert anchor_of(view(body(0.1, 4.0))[1]) == "middle"
    assert anchor_of(view(body(0.1, 4.0), PILLAR)[1]) == "left"
    assert anchor_of(view(body(0.1, 4.0), pillar_left)[1]) == "right"
    gap = [Solid((x, 0.0, 2.5), (0.2, 2.5, 0.1)) for x in (-0.1, 0.23)]
    assert anchor_of(view(body(0.1, 4.0), *gap)[1]) == "none"


@quick
@given(x=st.floats(-0.8, 0.8), z=st.floats(2.5, 5.5), turn=st.floats(-0.1, 0.1))
def test_the_middle_is_measured_at_the_visible_surface(x: float, z: float, turn: float) -> None:
    pose = Pose.from_rotvec([0.0, turn, 0.0], [0.3, 0.0, -0.2])
    scene, segment = view(body(x, z), pose=pose)
    place, cov = measured_anchor(segment, "middle", scene)
    gap = place - [x, 0.0, z - SIZE[2] / 2]
    assert np.linalg.norm(gap) < 0.06
    assert gap @ np.linalg.solve(cov, gap) < 6.0
    np.testing.assert_allclose(cov, cov.T, atol=1e-12)


def test_depth_uncertainty_grows_with_the_square_of_the_distance() -> None:
    sigmas = []
    for z in (2.5, 5.0):
        scene, segment = view(body(0.0, z))
        _, cov = measured_anchor(segment, "middle", scene)
        sigmas.append(np.sqrt(np.diag(cov)))
    assert sigmas[1][2] > 2.5 * sigmas[0][2]
    assert sigmas[1][0] == pytest.approx(sigmas[0][0], rel=0.05)


def test_the_lateral_position_is_unknown_when_both_sides_are_cut() -> None:
    scene, segment = view(body(0.0, 4.0))
    known = measured_anchor(segment, "middle", scene)[1]
    unknown = measured_anchor(segment, "none", scene)[1]
    assert unknown[0, 0] > 50 * known[0, 0]
    assert unknown[2, 2] == pytest.approx(known[2, 2], rel=0.01)


def test_the_sides_are_half_a_width_from_the_middle() -> None:
    scene, segment = view(body(0.2, 4.0))
    places = {a: measured_anchor(segment, a, scene)[0] for a in ("left", "middle", "right")}
    for side, sign in (("left", -1), ("right", 1)):
        gap = places[side] - places["middle"]
        np.testing.assert_allclose(gap, [sign * SIZE[0] / 2, 0, 0], atol=0.03)


@quick
@given(x=st.floats(-0.8, 0.8), z=st.floats(2.5, 5.5))
def test_the_extent_matches_the_body(x: float, z: float) -> None:
    _, segment = view(Solid((x, 0.0, z), (0.45, 1.2, 0.01)))
    assert extent_m(segment, GRID) == pytest.approx((0.45, 1.2), abs=0.05)


def test_the_middle_lies_behind_the_visible_surface() -> None:
    outline, _ = outlined(0.0, 4.0)
    assert 4.0 - SIZE[2] / 2 < outline.middle[2] < 4.2


# --- what is learned over time -------------------------------------------------------------


def test_the_extent_shrinks_slowly() -> None:
    outline, _ = outlined(0.0, 4.0)
    before = outline.width
    scene, segment = view(Solid((0.0, 0.0, 4.0), (0.2, 1.2, 0.1)))
    outline.note(segment, np.array([0.0, 0.0, 4.0]), scene, 0.1)
    assert outline.width == pytest.approx(0.97 * before)
    for _ in range(100):
        outline.note(segment, np.array([0.0, 0.0, 4.0]), scene, 0.2)
    assert outline.width == pytest.approx(0.2, abs=0.05)


def test_only_an_outline_taller_than_wide_is_upright() -> None:
    assert outlined(0.0, 4.0)[0].upright
    scene, segment = view(Solid((0.0, 0.5, 4.0), (0.6, 0.4, 0.1)))
    assert not Outline.of(segment, scene).upright


@pytest.mark.parametrize(
    ("x", "others", "cut", "beside"),
    [
        (0.1, (), False, False),
        (0.1, (on_floor(0.3, 2.4, (0.3, 2.4, 0.1)),), True, True),
        (0.1, (on_floor(-0.1, 2.4, (0.3, 2.4, 0.1)),), True, True),
        (EDGE_M, (), True, False),
        (-EDGE_M, (), True, False),
    ],
)
def test_only_an_outline_cut_off_by_a_nearer_object_is_beside_it(
    x: float, others: tuple[Shape, ...], cut: bool, beside: bool
) -> None:
    scene, segment = view(body(x, 4.0), *others)
    assert any(segment.cut[:2]) is cut
    assert Outline.of(segment, scene).beside_nearer is beside


@pytest.mark.parametrize(
    ("y", "others", "hangs"),
    [
        (0.4, (), False),
        (-0.5, (), True),
        (-0.5, (on_floor(0.0, 2.4, (1.0, 1.2, 0.1)),), False),
    ],
)
def test_only_what_is_seen_to_end_far_above_the_ground_hangs(
    y: float, others: tuple[Shape, ...], hangs: bool
) -> None:
    thing = Solid((0.0, y, 4.0), (0.45, 0.8, 0.1))
    scene, segment = view(thing, *others)
    outline = Outline.of(segment, scene)
    outline.note(segment, np.array([0.0, y, 4.0]), scene, 0.0)
    assert outline.hangs is hangs


def test_frames_are_counted_by_their_motion_evidence() -> None:
    outline, _ = outlined(0.0, 4.0)
    assert (outline.arrived_frames, outline.uncovered_frames, outline.is_static) == (1, 0, False)
    scene, still = view(body(0.0, 4.0), evidence=STATIC)
    outline.note(still, np.array([0.0, 0.0, 4.0]), scene, 0.1)
    assert (outline.arrived_frames, outline.uncovered_frames, outline.is_static) == (1, 0, True)
    scene, left = view(body(0.0, 4.0), evidence=3)
    outline.note(left, np.array([0.0, 0.0, 4.0]), scene, 0.1)
    assert (outline.arrived_frames, outline.uncovered_frames, outline.is_static) == (1, 1, False)


def test_a_limb_is_included_and_another_body_is_not() -> None:
    trunk, leg = Solid((0.0, -0.2, 4.0), (0.5, 0.8, 0.2)), Solid((0.1, 0.5, 3.95), (0.18, 0.5, 0.1))
    scene, segment = view(trunk, leg)
    outline = Outline.of(segment, scene)
    outline.note(segment, np.array([0.0, -0.2, 4.0]), scene, 0.0)
    limb = segment_of(scene, cells_of(leg, [*ROOM, trunk, leg]))
    _, far = view(body(1.5, 5.0))
    assert not outline.take(far, scene, None)
    assert outline.take(limb, scene, None)
    np.testing.assert_array_equal(outline.segment.mask, segment.mask | limb.mask)
    where = outline.expected(np.array([0.0, -0.2, 4.0]), HERE, GRID)
    assert overlap(where.mask, outline.segment.mask) > 0.99


def test_the_larger_rest_of_a_partly_seen_body_is_included() -> None:
    trunk, leg = Solid((0.0, -0.2, 4.0), (0.5, 0.8, 0.2)), Solid((0.1, 0.5, 3.95), (0.18, 0.5, 0.1))
    scene, whole = view(trunk, leg)
    limb = segment_of(scene, cells_of(leg, [*ROOM, trunk, leg]))
    outline = Outline.of(limb, scene)
    outline.note(limb, np.array([0.1, 0.5, 4.0]), scene, 0.0)
    assert outline.take(whole, scene, None)
    np.testing.assert_array_equal(outline.segment.mask, whole.mask | limb.mask)


def test_a_separately_moving_outline_never_idles() -> None:
    outline, _ = outlined(0.0, 4.0)
    assert [outline.count_idle(tentative=True, may_stand=False) for _ in range(5)] == [0] * 5


def test_a_static_outline_idles_only_while_tentative() -> None:
    outline, scene = outlined(0.0, 4.0)
    still = view(body(0.0, 4.0), evidence=STATIC)[1]
    outline.note(still, np.array([0.0, 0.0, 4.0]), scene, 0.1)
    assert [outline.count_idle(tentative=False, may_stand=False) for _ in range(3)] == [0, 0, 0]
    assert [outline.count_idle(tentative=True, may_stand=False) for _ in range(3)] == [1, 2, 3]
    outline.seen = False
    assert outline.count_idle(tentative=True, may_stand=False) == 0


def test_a_confirmed_outline_idles_while_absorbing_static_surroundings() -> None:
    outline, _ = outlined(0.0, 4.0)
    scene, twice = view(Solid((0.2, 0.0, 4.0), (0.9, 1.2, 0.1)), evidence=STATIC)
    outline.note(twice, np.array([0.0, 0.0, 4.0]), scene, 0.1)
    assert [outline.count_idle(tentative=False, may_stand=False) for _ in range(3)] == [1, 2, 3]


def test_cells_of_visible_outlines_are_not_free() -> None:
    one, other = outlined(0.0, 4.0)[0], outlined(0.8, 4.0)[0]
    other.seen = False
    np.testing.assert_array_equal(free_cells([one, other], GRID), ~one.segment.mask)
    assert free_cells([], GRID).all()


def test_an_object_lying_on_the_floor_is_not_upright() -> None:
    scene, segment = view(on_floor(0.0, 3.0, (0.5, 0.3, 0.6)))
    assert not Outline.of(segment, scene).upright
