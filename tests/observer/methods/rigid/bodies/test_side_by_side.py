"""People side by side, as boxes at known places: two bodies, however alike they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.segment_tracking import track_segments
from observer.methods.rigid.bodies.side_by_side import nearest_first, parted, separated
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, segment_of
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import Parameters
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

from ..solid_worlds import (
    CAMERA,
    GRID,
    HERE,
    ROOM,
    Shape,
    Solid,
    SolidView,
    arrived,
    cells_of,
    on_floor,
    outlined,
    patch,
    person,
    points_on,
    seen,
    step_to,
    tracked,
)

quick = settings(max_examples=15)
LOW = Pose(np.eye(3), np.array([0.0, 0.7, 0.0]))


def as_one(*things: Shape, T_world_camera: Pose = HERE) -> tuple[DenseScene, Segment]:
    """Things that have arrived in a room, all taken for one segment."""
    shapes = [*ROOM, *things]
    mask = np.any([cells_of(thing, shapes, T_world_camera) for thing in things], axis=0)
    scene = seen(shapes, T_world_camera, np.where(mask, ARRIVED, STATIC).astype(np.uint8))
    return scene, segment_of(scene, mask & scene.standing)


@quick
@given(z=st.floats(2.5, 5.5), apart=st.floats(0.62, 1.0), x=st.floats(-0.4, 0.4))
def test_two_people_with_a_gap_between_them_are_parted(z: float, apart: float, x: float) -> None:
    one, other = person(x - apart / 2, z), person(x + apart / 2, z)
    scene, both = as_one(one, other)
    halves = parted(both, scene)
    assert halves is not None
    for half, who in zip(halves, (one, other), strict=True):
        np.testing.assert_array_equal(half.mask, cells_of(who, [*ROOM, one, other]) & both.mask)


def test_two_people_whose_arms_touch_are_parted() -> None:
    """Together they are wider than anyone."""
    arms = Solid((0.0, -0.1, 4.0), (0.3, 0.4, 0.2))
    scene, both = as_one(person(-0.36, 4.0), person(0.36, 4.0), arms)
    halves = parted(both, scene)
    assert halves is not None
    assert [round(half.columns[1]) for half in halves] == pytest.approx(
        [GRID.to_cells(CAMERA.project(np.array([[x, 0.0, 3.9]]))[0])[0, 0] for x in (-0.36, 0.36)],
        abs=4,
    )


def test_the_ground_between_the_feet_does_not_hide_a_gap() -> None:
    """Seen from above it fills much of the gap, as near as the feet are."""
    scene, both = as_one(person(-0.4, 4.0), person(0.4, 4.0))
    _, top, _, bottom = both.box
    gap = (slice(top + (bottom - top) // 3, bottom), slice(*_gap_columns(both)))
    disparity, standing = scene.disparity.copy(), scene.standing.copy()
    disparity[gap], standing[gap] = both.disparity, False
    assert parted(both, replace(scene, disparity=disparity, standing=standing)) is not None
    standing[gap] = True
    assert parted(both, replace(scene, disparity=disparity, standing=standing)) is None


def test_a_gap_is_found_beside_somebody_of_whom_little_is_in_the_segment() -> None:
    """It is less wide than the columns that hold few cells, as those between touching arms do."""
    one, other = person(-0.33, 4.0), on_floor(0.45, 4.0, (0.7, 1.6, 0.2))
    scene, both = as_one(one, other)
    mask = both.mask.copy()
    _, top, _, bottom = both.box
    # Shares of the height at which the segment lacks the other person.
    for first, last in ((0.43, 0.8), (0.86, 1.0)):
        rows = slice(top + round(first * (bottom - top)), top + round(last * (bottom - top)))
        mask[rows] &= ~cells_of(other, [*ROOM, one, other])[rows]
    assert parted(segment_of(scene, mask), scene) is not None


def _gap_columns(segment: Segment) -> tuple[int, int]:
    """The first column without cells of a segment within its box, and that after the last."""
    left, _, right, _ = segment.box
    empty = left + np.flatnonzero(~segment.mask[:, left:right].any(axis=0))
    return int(empty[0]), int(empty[-1]) + 1


@pytest.mark.parametrize(
    ("things", "pose"),
    [
        ((person(0.0, 4.0),), HERE),
        # Shoulder to shoulder: nothing is seen between them.
        ((person(-0.23, 4.0), person(0.23, 4.0)), HERE),
        # A raised arm, and a box that is carried.
        ((person(0.0, 4.0), Solid((0.45, -0.4, 4.0), (0.25, 0.4, 0.2))), HERE),
        # Somebody with a board across the chest, and a wide thing without a gap.
        ((person(0.0, 4.0), Solid((0.0, 0.0, 3.9), (1.3, 0.3, 0.1))), HERE),
        ((on_floor(0.0, 4.0, (1.3, 1.6, 0.2)),), HERE),
        # The legs of one person, of whom a low camera sees nothing else.
        ((on_floor(-0.2, 1.2, (0.2, 0.85, 0.2)), on_floor(0.2, 1.2, (0.2, 0.85, 0.2))), LOW),
        # A table.
        ((on_floor(-0.6, 4.0, (0.25, 0.7, 0.2)), on_floor(0.6, 4.0, (0.25, 0.7, 0.2))), LOW),
    ],
    ids=["one", "touching", "arm", "board", "wide", "legs", "low"],
)
def test_one_body_is_not_parted(things: tuple[Shape, ...], pose: Pose) -> None:
    scene, segment = as_one(*things, T_world_camera=pose)
    assert parted(segment, scene) is None
    assert separated([segment], scene) == [segment]


def test_a_wide_gap_parts_two_people_of_whom_a_low_camera_sees_the_legs() -> None:
    """So close by, the legs of one person are not so far apart up to the image's top."""
    legs = [on_floor(x, 1.2, (0.2, 0.85, 0.2)) for x in (-0.4, 0.4)]
    scene, both = as_one(*legs, T_world_camera=LOW)
    assert both.cut[2], "the image's top cuts them off"
    assert parted(both, scene) is not None


def test_an_arm_that_hangs_into_the_view_beside_a_person_is_no_other_one() -> None:
    arm = Solid((0.4, 0.15, 1.2), (0.15, 0.7, 0.15))
    scene, both = as_one(on_floor(-0.25, 1.2, (0.3, 0.85, 0.2)), arm, T_world_camera=LOW)
    assert both.cut[2]
    assert parted(both, scene) is None


def test_without_a_known_ground_nobody_is_parted() -> None:
    scene, both = as_one(person(-0.4, 4.0), person(0.4, 4.0))
    assert parted(both, scene) is not None
    assert parted(both, replace(scene, ground=None)) is None


def test_a_new_segment_of_two_people_begins_two_tracks() -> None:
    scene, both = as_one(person(-0.4, 4.0), person(0.4, 4.0))
    assert len(separated([both], scene)) == 2


def test_a_body_that_shows_two_people_becomes_two_that_move_alike() -> None:
    """They are parted once the gap between them is seen for a moment."""
    view = SolidView()
    for _ in range(5):
        view.step(ROOM)
    for k in range(24):
        x = -0.9 + 0.08 * k
        # At first something is seen between them, as where depth is smeared.
        between = [Solid((x, 0.2, 4.0), (0.3, 1.5, 0.2))] if k < 12 else []
        view.step([*ROOM, person(x - 0.36, 4.0), person(x + 0.36, 4.0), *between])
        if k == 11:
            (before,) = [t for t in view.tracks if t.state is TrackState.CONFIRMED]
    both = sorted(
        (t for t in view.tracks if t.state is TrackState.CONFIRMED), key=lambda t: t.centre[0]
    )
    assert [t.centre[0] - x for t in both] == pytest.approx([-0.36, 0.36], abs=0.1)
    assert before.id in [t.id for t in both]
    for track in both:
        assert track.mean[VELOCITY][0] == pytest.approx(0.8, abs=0.2)
        assert track.outline is not None
        assert track.outline.width == pytest.approx(0.45, abs=0.12)


def test_the_half_nearer_to_a_bodys_origin_keeps_its_number() -> None:
    """Its segment grew over another person, who may be the larger one."""
    one, other = person(-0.4, 4.0), on_floor(0.4, 4.0, (0.6, 1.7, 0.2))
    tracks, track = outlined(one, TrackIds())
    scene, both = as_one(one, other)
    halves = parted(both, scene)
    assert halves is not None
    assert halves[1].area > halves[0].area
    assert nearest_first(halves, track, scene) == halves
    assert nearest_first((halves[1], halves[0]), track, scene) == halves
    assert tracks == [track]


def test_points_on_both_of_two_people_no_longer_hold_them_together() -> None:
    """One group of points on both was taken for one rigid body, with the segment of one of them."""
    left, right = person(-0.4, 4.0), person(0.4, 4.0)
    numbers = TrackIds()
    tracks: list[BodyTrack] = []
    points = points_on(np.concatenate([patch(-0.4, 0.0, 3.87), patch(0.4, 0.0, 3.87)]))
    tracked(tracks, TrackedPoints.none(), arrived(left), numbers)
    (track,) = tracks
    track.rigid, track.state = True, TrackState.CONFIRMED
    points = points.but(obstacle=np.full(len(points), track.id))
    scene = arrived(left, right)
    least = Parameters().obstacles.min_points
    found = track_segments(tracks, points, scene, step_to(), numbers, least)
    assert sorted(round(t.centre[0], 1) for t in tracks) == [-0.4, 0.4]
    assert not any(t.rigid for t in tracks)
    np.testing.assert_array_equal(found.obstacle[9:], NO_OBSTACLE)
