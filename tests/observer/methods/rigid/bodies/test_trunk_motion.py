"""The velocity of a body with limbs: measured on its trunk, and horizontal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.legs import shows_only_legs
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.trunk_motion import measure_trunk
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import segment_of
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

from ..solid_worlds import GRID, ROOM, Solid, cells_of, seen
from .planted_bodies import DT

MakeTrack = Callable[..., BodyTrack]
PLACE = np.array([0.0, 0.0, 4.0])
WALK = np.array([0.9, 0.0, 0.0])


def scene_at(place: Float64Array, *, textured: bool = True) -> tuple[DenseScene, Outline]:
    """A person in clothes of uniform texture, at a place."""
    thing = Solid((float(place[0]), float(place[1]), float(place[2])), (0.45, 1.2, 0.1))
    scene = seen([*ROOM, thing])
    segment = segment_of(scene, cells_of(thing, [*ROOM, thing]))
    grain = np.random.default_rng(3).normal(0.0, 1.0, GRID.shape).astype(np.float32)
    clothes = cv2.GaussianBlur(grain, (0, 0), 1.5)
    clothes = 128 + 25 * clothes / clothes.std()
    ahead = GRID.per_metre(segment.disparity) * place[0]
    move = np.array([[1.0, 0.0, ahead], [0.0, 1.0, 0.0]])
    clothes = cv2.warpAffine(clothes, move, (GRID.width, GRID.height))
    image = np.where(segment.mask, clothes, 90.0) if textured else np.full(GRID.shape, 90.0)
    left = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return replace(scene, left=left), Outline.of(segment, scene)


def no_points() -> tuple[TrackedPoints, WorldSightings]:
    return TrackedPoints.none(), WorldSightings(np.zeros((0, 3)), np.zeros((0, 3, 3)))


def by_picture(track: BodyTrack, velocity: Float64Array, frames: int = 6) -> Float64Array:
    """(3,) m/s, the body's velocity after some frames without points."""
    none: NDArray[np.intp] = np.zeros(0, np.intp)
    outline: Outline | None = None
    for k in range(frames):
        scene, track.outline = scene_at(PLACE + velocity * k * DT)
        if outline is not None:
            track.outline.trunk = outline.trunk
        track.age_s = k * DT
        measure_trunk(track, none, *no_points(), scene, DT)
        outline = track.outline
    return np.asarray(track.mean[VELOCITY])


@pytest.fixture
def unknown(make_track: MakeTrack) -> BodyTrack:
    """Represents a person whose velocity is not known yet."""
    return make_track(tuple(PLACE), (0.0, 0.0, 0.0), sigma=1.0)


def test_the_image_gives_the_velocity_across_the_line_of_sight(unknown: BodyTrack) -> None:
    found = by_picture(unknown, WALK)
    np.testing.assert_allclose(found[:2], WALK[:2], atol=0.1)


def test_the_image_gives_no_velocity_along_the_line_of_sight(unknown: BodyTrack) -> None:
    before = unknown.filter.covariance[VELOCITY, VELOCITY][2, 2]
    by_picture(unknown, WALK)
    assert unknown.filter.covariance[VELOCITY, VELOCITY][2, 2] > 0.2 * before


def test_points_below_the_trunk_are_ignored(unknown: BodyTrack) -> None:
    """Legs swing."""
    scene, track = scene_at(PLACE, textured=False)[0], unknown
    track.outline = scene_at(PLACE)[1]
    u0, v0, u1, v1 = track.outline.box_px
    heights = np.concatenate([np.linspace(0.05, 0.55, 20), np.linspace(0.65, 0.99, 30)])
    px = np.stack([np.linspace(u0, u1, 50), v0 + heights * (v1 - v0)], axis=1).astype(np.float32)
    sums = PositionVelocityFilter.begin(np.zeros((50, 3)), np.zeros((50, 3, 3)))
    points = TrackedPoints.begin(0, px, px, np.full(50, 15.0), sums)
    sightings = WorldSightings(np.tile(PLACE, (50, 1)), np.tile(np.eye(3) * 1e4, (50, 1, 1)))
    measure_trunk(track, np.arange(50), points, sightings, scene, DT)
    assert set(track.outline.depths.number) == set(range(20))


def test_the_vertical_velocity_of_a_body_is_zero(make_track: MakeTrack) -> None:
    track = make_track(tuple(PLACE), (0.4, 0.3, -0.6), sigma=0.3)
    scene, track.outline = scene_at(PLACE, textured=False)
    measure_trunk(track, np.zeros(0, np.intp), *no_points(), scene, DT)
    np.testing.assert_allclose(track.mean[VELOCITY], (0.4, 0.0, -0.6), atol=0.02)


@pytest.mark.parametrize(("height_m", "trunk"), [(0.5, False), (1.6, True)])
def test_a_view_of_only_legs_has_no_trunk(unknown: BodyTrack, height_m: float, trunk: bool) -> None:
    """The image's upper border is ``height_m`` above the ground."""
    scene, outline = scene_at(PLACE)
    above = replace(outline.segment, cut=(False, False, True, False))
    px = GRID.to_px(np.array([[above.columns[1], above.box[1]]]))
    top = GRID.camera.triangulate(px, np.array([above.disparity]))[0]
    ground = GroundPlane(np.array([0.0, 1.0, 0.0]), float(top[1]) + height_m)
    unknown.outline = replace(outline, segment=above)
    scene = replace(scene, ground=ground)
    unknown.outline.only_legs = shows_only_legs(unknown.outline.segment, scene)
    assert unknown.outline.only_legs is not trunk
    measure_trunk(unknown, np.zeros(0, np.intp), *no_points(), scene, DT)
    assert (unknown.outline.trunk is not None) is trunk


@pytest.mark.parametrize("only_legs", [False, True])
def test_the_velocity_becomes_uncertain_when_limbs_are_found(
    make_track: MakeTrack, only_legs: bool
) -> None:
    """Unless only legs are in view: then there is no better source."""
    track = make_track(tuple(PLACE), (0.4, 0.0, -0.6), sigma=0.1)
    track.outline = replace(scene_at(PLACE)[1], only_legs=only_legs)
    before = np.sqrt(np.diag(track.filter.covariance[VELOCITY, VELOCITY]))
    track.loosen()
    after = np.sqrt(np.diag(track.filter.covariance[VELOCITY, VELOCITY]))
    np.testing.assert_allclose(track.mean[VELOCITY], (0.4, 0.0, -0.6))
    np.testing.assert_allclose(after**2 - before**2, 0 if only_legs else [0.25, 0.0025, 0.25])
