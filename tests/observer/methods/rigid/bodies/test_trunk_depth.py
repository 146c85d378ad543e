"""The distance of a trunk, from points that keep their places on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.bodies.trunk_depth import TrunkDepths
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

from ..solid_worlds import ROOM, seen
from .planted_bodies import DT

MakeTrack = Callable[..., BodyTrack]
SIGMA_M = 0.03
PLACE = np.array([0.0, 0.0, 4.0])
AWAY = np.array([0.0, 0.0, 0.8])
SCENE = seen(ROOM)

Limbs = Callable[[float, Float64Array], Float64Array]


def still(_: float, places: Float64Array) -> Float64Array:
    """No limb moves on its own."""
    return np.zeros_like(places)


def followed(
    track: BodyTrack,
    velocity: Float64Array,
    *,
    count: int = 20,
    frames: int = 15,
    renewed: int = 0,
    left_only: bool = False,
    limbs: Limbs = still,
) -> BodyTrack:
    """The track after some frames that show points on a walking body.

    Args:
        renewed: points replaced in every frame. limbs: (N, 3) m, offset of the points at a
            time, s, from where they would be on a rigid body.
    """
    rng = np.random.default_rng(5)
    low = (-0.25, -0.3, -0.1)
    place = rng.uniform(low, (-0.05 if left_only else 0.25, 0.3, 0.1), (count, 3))
    number, depths = np.arange(count), TrunkDepths()
    for k in range(frames):
        if k > 0:
            track.filter = track.filter.predicted(DT, (0.6, 1.1), (0.0, 0.0), None)
        if renewed:
            number = np.concatenate([number[renewed:], number.max() + 1 + np.arange(renewed)])
            place = np.concatenate([place[renewed:], place[:renewed]])
        body = PLACE + velocity * k * DT
        at = body + place + limbs(k * DT, place) + rng.normal(0, SIGMA_M, (count, 3)) * (0, 0, 1)
        px = np.zeros((count, 2), np.float32)
        sums = PositionVelocityFilter.begin(np.zeros((count, 3)), np.zeros((count, 3, 3)))
        points = TrackedPoints.begin(0, px, px, np.full(count, 15.0), sums).but(number=number)
        information = np.tile(np.diag([1e6, 1e6, SIGMA_M**-2]), (count, 1, 1))
        sightings = WorldSightings(at, information)
        every = np.arange(count)
        track.filter = depths.measure(track.filter, every, points, sightings, SCENE, DT)
    return track


@pytest.fixture
def unknown(make_track: MakeTrack) -> BodyTrack:
    """Represents a person whose velocity is not known yet."""
    return make_track(tuple(PLACE), (0.0, 0.0, 0.0), sigma=1.0)


def test_points_give_only_the_velocity_along_the_line_of_sight(unknown: BodyTrack) -> None:
    track = followed(unknown, AWAY)
    assert track.mean[VELOCITY][2] == pytest.approx(0.8, abs=0.1)
    cov = track.filter.covariance[VELOCITY, VELOCITY]
    assert cov[2, 2] < 0.15**2
    assert cov[0, 0] > 0.9


def test_renewed_points_also_give_the_velocity_along_the_line_of_sight(unknown: BodyTrack) -> None:
    track = followed(unknown, AWAY, renewed=4)
    assert track.mean[VELOCITY][2] == pytest.approx(0.8, abs=0.15)


def test_points_on_one_side_of_a_crossing_person_add_no_velocity_along(
    make_track: MakeTrack,
) -> None:
    """Even though the line of sight turns."""
    across = np.array([1.2, 0.0, 0.0])
    track = make_track(tuple(PLACE), tuple(across), sigma=0.1)
    followed(track, across, left_only=True)
    assert abs(track.mean[VELOCITY][2]) < 0.08


def test_a_swinging_arm_hardly_changes_the_velocity(unknown: BodyTrack) -> None:
    def arm(time: float, places: Float64Array) -> Float64Array:
        out = np.zeros_like(places)
        out[::5, 2] = 0.25 * np.sin(6 * time)
        return out

    track = followed(unknown, AWAY, limbs=arm)
    assert track.mean[VELOCITY][2] == pytest.approx(0.8, abs=0.12)


def test_points_jumping_away_from_a_known_body_hardly_count(make_track: MakeTrack) -> None:
    track = make_track(tuple(PLACE), tuple(AWAY), sigma=0.05)
    followed(track, AWAY, frames=3)
    followed(track, AWAY, frames=2, limbs=lambda time, p: np.full_like(p, 0.4 * (time > 0)))
    assert np.linalg.norm(track.mean[VELOCITY] - AWAY) < 0.2


@pytest.mark.parametrize(("count", "frames"), [(2, 5), (20, 1)])
def test_too_few_or_newly_seen_points_give_no_velocity(
    unknown: BodyTrack, count: int, frames: int
) -> None:
    before = unknown.filter.covariance[VELOCITY, VELOCITY][2, 2]
    followed(unknown, AWAY, count=count, frames=frames)
    assert unknown.mean[VELOCITY][2] == 0
    assert unknown.filter.covariance[VELOCITY, VELOCITY][2, 2] >= before
