"""People with only their legs in view, as boxes at known places."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.bodies.legs import at_hips, is_other_leg, shows_only_legs, swing_cov
from observer.methods.rigid.bodies.outline import Outline, anchor_of, measured_anchor
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, segment_of
from observer.types import TrackState

from ..solid_worlds import DT, ROOM, Solid, SolidView, cells_of, on_floor, seen

quick = settings(max_examples=10)
# Metres: height of a small robot's camera above the floor; the world's y axis points down.
LOW_M = 0.3
LOW = Pose(np.eye(3), np.array([0.0, 1.0 - LOW_M, 0.0]))


def leg(x: float, z: float) -> Solid:
    """A leg that extends beyond the image."""
    return on_floor(x, z, (0.16, 1.2, 0.16))


def legs(*places: tuple[float, float]) -> tuple[DenseScene, list[Segment]]:
    """Legs at x, z metres in a room that was empty before, and the segment of each."""
    solids = [leg(*place) for place in places]
    shapes = [*ROOM, *solids]
    masks = [cells_of(solid, shapes, LOW) for solid in solids]
    evidence = np.where(np.any(masks, axis=0), ARRIVED, STATIC).astype(np.uint8)
    scene = seen(shapes, LOW, evidence)
    return scene, [segment_of(scene, mask & scene.standing) for mask in masks]


def striding(x: float, z: float) -> list[Solid]:
    """Two legs in a long stride, apart at the feet, built from slices of a leg's height."""
    heights = np.arange(0.05, 0.86, 0.1)
    out = (0.85 - heights) * 0.6
    return [
        Solid((x + side * away, 1.0 - height, z), (0.16, 0.1, 0.16))
        for side in (-1, 1)
        for height, away in zip(heights, out, strict=True)
    ]


def outlined(segment: Segment, scene: DenseScene) -> Outline:
    outline = Outline.of(segment, scene)
    outline.note(segment, np.zeros(3), scene, 0.0)
    outline.only_legs = shows_only_legs(segment, scene)
    return outline


@pytest.mark.parametrize(("z", "only"), [(0.9, True), (1.2, True), (1.6, False), (4.0, False)])
def test_only_legs_are_visible_of_a_near_person(z: float, only: bool) -> None:
    """The image ends 0.4 m above the camera per metre of distance."""
    scene, (segment,) = legs((0.0, z))
    assert shows_only_legs(segment, scene) is only


def test_the_other_leg_is_included_regardless_of_its_size() -> None:
    scene, (one, other) = legs((-0.25, 1.2), (0.2, 1.3))
    outline = outlined(one, scene)
    assert outline.only_legs
    assert outline.take(other, scene, None)
    np.testing.assert_array_equal(outline.segment.mask, one.mask | other.mask)


def test_an_object_beside_a_fully_visible_person_is_not_a_leg() -> None:
    scene, (one, other) = legs((-0.25, 3.0), (0.2, 3.0))
    outline = outlined(one, scene)
    assert not outline.take(other, scene, None)


@pytest.mark.parametrize("place", [(0.35, 2.2), (0.75, 1.35)], ids=["behind", "aside"])
def test_the_leg_of_another_person_is_not_included(place: tuple[float, float]) -> None:
    scene, (one, other) = legs((-0.7, 1.35), place)
    assert not is_other_leg(scene, other, one, None)
    assert not outlined(one, scene).take(other, scene, None)


@pytest.mark.parametrize(
    ("heading", "same"), [((0, 0, -1), True), ((1, 0, 0), False), (None, True)]
)
def test_legs_stride_the_way_a_person_walks(heading: Any, same: bool) -> None:
    """Somebody who comes the other way is farther behind than the legs of one who crosses."""
    scene, (one, other) = legs((-0.2, 1.0), (0.25, 1.5))
    way = None if heading is None else np.array(heading, float)
    assert outlined(one, scene).take(other, scene, way) is same


def test_a_track_heads_somewhere_once_its_velocity_is_significant(make_track: Any) -> None:
    np.testing.assert_allclose(make_track(velocity=(0.6, 0, 0.8)).heading, [0.6, 0, 0.8])
    assert make_track(velocity=(0.6, 0, 0.8), sigma=1.0).heading is None
    assert make_track(velocity=(0, 0, 0)).heading is None


@quick
@given(near=st.floats(1.0, 1.2), apart=st.floats(0.0, 0.3))
def test_the_hips_are_midway_between_the_legs(near: float, apart: float) -> None:
    scene, (one, other) = legs((-0.2, near), (0.2, near + apart))
    both = segment_of(scene, one.mask | other.mask)
    middle = (one.disparity + other.disparity) / 2
    assert at_hips(both, scene).disparity == pytest.approx(middle, rel=0.02)


@pytest.mark.parametrize("x", [-0.3, 0.0, 0.4])
@pytest.mark.parametrize("z", [1.1, 1.2])
def test_the_hips_are_measured_with_a_foot_out_of_view(x: float, z: float) -> None:
    solids = striding(x, z)
    shapes = [*ROOM, *solids]
    mask = np.any([cells_of(each, shapes, LOW) for each in solids], axis=0)
    scene = seen(shapes, LOW, np.where(mask, ARRIVED, STATIC).astype(np.uint8))
    hips = at_hips(segment_of(scene, mask & scene.standing), scene)
    assert anchor_of(hips) == "middle"
    place, _ = measured_anchor(hips, "middle", scene)
    assert place[0] == pytest.approx(x, abs=0.02)


def test_a_leg_swings_across_the_line_of_sight() -> None:
    along = np.diag([0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.sqrt(np.diag(swing_cov(along))), [0.2, 0.2, 0.0])


def test_a_person_walking_past_close_by_is_one_body_moving_with_the_hips() -> None:
    """Each leg stands while the other one moves at twice the speed."""
    view, speed = SolidView(), 0.9
    omega = 2 * math.pi
    for _ in range(5):
        view.step(ROOM, LOW)
    velocities = []
    for k in range(13):
        t = k * DT
        hips, swing = -0.55 + speed * t, speed / omega * math.sin(omega * t)
        view.step([*ROOM, leg(hips - swing, 1.15), leg(hips + swing, 1.35)], LOW)
        shown = [t for t in view.tracks if t.state is TrackState.CONFIRMED]
        assert len(shown) <= 1
        velocities += [track.centre_velocity()[0] for track in shown]
    assert len(velocities) >= 6
    assert [track.outline.legs_seen for track in shown if track.outline] == [True]
    np.testing.assert_allclose(np.mean(velocities, axis=0), [speed, 0.0, 0.0], atol=0.15)
    assert abs(velocities[-1][2]) < 0.15
