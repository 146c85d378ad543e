"""The velocity of a body with limbs: across by its trunk's picture, along by its points."""

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
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.trunk_motion import measure_trunk
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import segment_of
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

from ..solid_worlds import GRID, ROOM, Solid, cells_of, seen

MakeTrack = Callable[..., BodyTrack]
DT = 1 / 15
SIGMA_M = 0.01
PLACE = np.array([0.0, 0.0, 4.0])
WALK = np.array([0.9, 0.0, 0.0])
AWAY = np.array([0.0, 0.0, 0.8])


def scene_at(place: Float64Array, *, textured: bool = True) -> tuple[DenseScene, Outline]:
    """A person in clothes of even grain, at a place."""
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


def points_on(track: BodyTrack, heights: Float64Array, moved: Float64Array) -> TrackedPoints:
    """Points (N,) at shares of the outline's height from its top, that went (N, 3) m in a frame."""
    assert track.outline is not None
    u0, v0, u1, v1 = track.outline.box_px
    across = np.linspace(u0, u1, len(heights))
    px = np.stack([across, v0 + heights * (v1 - v0)], axis=1).astype(np.float32)
    sums = PositionVelocityFilter.begin(np.zeros((len(px), 3)), np.zeros((len(px), 3, 3)))
    return TrackedPoints.begin(0, px, px, np.full(len(px), 15.0), sums).but(moved=moved)


def by_points(
    track: BodyTrack, heights: Float64Array, velocity: Float64Array, seed: int = 0
) -> Float64Array:
    """(3,) m/s, the body's velocity after one frame with points of velocities (N, 3) alone."""
    noise = np.random.default_rng(seed).normal(0, SIGMA_M, velocity.shape) * np.sqrt(2)
    scene, track.outline = scene_at(PLACE, textured=False)
    track.outline.middle = PLACE
    points = points_on(track, heights, velocity * DT + noise)
    information = np.broadcast_to(np.eye(3) / SIGMA_M**2, (len(points), 3, 3))
    sightings = WorldSightings(np.zeros((len(points), 3)), information)
    measure_trunk(track, np.arange(len(points)), points, sightings, scene, DT)
    return np.asarray(track.mean[VELOCITY])


def by_picture(track: BodyTrack, velocity: Float64Array, frames: int = 6) -> Float64Array:
    """(3,) m/s, the body's velocity after some frames without points."""
    none: NDArray[np.intp] = np.zeros(0, np.intp)
    outline: Outline | None = None
    for k in range(frames):
        scene, track.outline = scene_at(PLACE + velocity * k * DT)
        if outline is not None:
            track.outline.trunk = outline.trunk
        points = points_on(track, np.zeros(0), np.zeros((0, 3)))
        sightings = WorldSightings(np.zeros((0, 3)), np.zeros((0, 3, 3)))
        track.age_s = k * DT
        measure_trunk(track, none, points, sightings, scene, DT)
        outline = track.outline
    return np.asarray(track.mean[VELOCITY])


@pytest.fixture
def unknown(make_track: MakeTrack) -> BodyTrack:
    """Stands for a person whose velocity is not known yet."""
    return make_track(tuple(PLACE), (0.0, 0.0, 0.0), sigma=1.0)


def test_its_picture_tells_the_velocity_across(unknown: BodyTrack) -> None:
    found = by_picture(unknown, WALK)
    np.testing.assert_allclose(found[:2], WALK[:2], atol=0.1)


def test_its_picture_tells_nothing_along(unknown: BodyTrack) -> None:
    before = unknown.filter.covariance[VELOCITY, VELOCITY][2, 2]
    by_picture(unknown, WALK)
    assert unknown.filter.covariance[VELOCITY, VELOCITY][2, 2] > 0.3 * before


def test_points_tell_the_velocity_along(unknown: BodyTrack) -> None:
    before = unknown.filter.covariance[VELOCITY, VELOCITY]
    found = by_points(unknown, np.linspace(0.05, 0.55, 40), np.tile(AWAY, (40, 1)))
    assert found[2] == pytest.approx(AWAY[2], abs=0.25)
    after = unknown.filter.covariance[VELOCITY, VELOCITY]
    assert after[2, 2] < 0.2 * before[2, 2]
    assert after[0, 0] > 0.7 * before[0, 0], "across they are rather those of arms"


def test_legs_that_swing_change_nothing_at_all(make_track: MakeTrack) -> None:
    trunk, legs = np.linspace(0.05, 0.55, 20), np.linspace(0.65, 0.99, 30)
    velocity = np.tile(AWAY, (50, 1))
    found = []
    for swing in (0.0, 2.0, -2.0):
        track = make_track(tuple(PLACE), (0.0, 0.0, 0.0), sigma=0.5)
        velocity[20:, 2] = AWAY[2] + swing
        found.append(by_points(track, np.concatenate([trunk, legs]), velocity))
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


@pytest.mark.parametrize("swing", [-2.0, 2.0])
def test_an_arm_that_swings_before_the_trunk_hardly_changes_it(
    unknown: BodyTrack, swing: float
) -> None:
    velocity = np.tile(AWAY, (40, 1))
    velocity[::5, 2] += swing
    found = by_points(unknown, np.linspace(0.05, 0.55, 40), velocity)
    assert found[2] == pytest.approx(AWAY[2], abs=0.25)


def test_points_that_disagree_make_it_less_sure(make_track: MakeTrack) -> None:
    heights, spread = np.linspace(0.05, 0.55, 40), []
    for scatter in (0.0, 0.8):
        track = make_track(tuple(PLACE), (0.0, 0.0, 0.0), sigma=0.5)
        jitter = np.random.default_rng(1).normal(0, scatter, (40, 3))
        by_points(track, heights, AWAY + jitter)
        spread.append(track.filter.covariance[VELOCITY, VELOCITY][2, 2])
    assert spread[1] > 1.5 * spread[0]


def test_what_moves_quite_unlike_a_body_that_is_known_hardly_counts(make_track: MakeTrack) -> None:
    """Far from its velocity it is rather that of a limb."""
    track = make_track(tuple(PLACE), tuple(AWAY), sigma=0.1)
    faster = AWAY + np.tile([0.0, 0.0, 3.0], (10, 1))
    found = by_points(track, np.linspace(0.05, 0.55, 10), faster)
    assert np.linalg.norm(found - AWAY) < 0.1


def test_a_few_points_measure_nothing(unknown: BodyTrack) -> None:
    before = unknown.filter
    by_points(unknown, np.array([0.1, 0.2, 0.3]), np.tile(AWAY, (3, 1)))
    assert unknown.filter is before


def test_points_seen_for_the_first_time_measure_nothing(unknown: BodyTrack) -> None:
    before = unknown.filter
    by_points(unknown, np.linspace(0.1, 0.5, 20), np.full((20, 3), np.nan))
    assert unknown.filter is before
