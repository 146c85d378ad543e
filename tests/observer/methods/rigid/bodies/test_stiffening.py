"""When points on a supposed person turn it into a rigid body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.parameters import ObstacleParameters
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

from ..moving_points import SIGMA, motion
from ..solid_worlds import Solid, outline_of, patch, points_on

MakeTrack = Callable[..., BodyTrack]


def low_body(make_track: MakeTrack) -> BodyTrack:
    """A body that is too low for a person, known by its outline alone."""
    track = make_track((0.0, 0.0, 3.95), (0.9, 0.0, 0.0), sigma=0.03)
    track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.6, 0.5, 0.1)))
    track.rigid = False
    return track


def spawn_on(
    track: BodyTrack, speed: float, at: tuple[float, ...] = (0.1,), sigma: float = SIGMA
) -> None:
    """Find a group of points that move at a speed, m/s, at each of some places across the body."""
    tracker = BodyTracker()
    tracker.tracks.append(track)
    places = np.concatenate([patch(x, 0.0, 3.95, 0.1) for x in at])
    group = np.repeat(np.arange(len(at)), len(places) // len(at))
    points = points_on(places).but(
        obstacle=np.full(len(places), NO_OBSTACLE), within=np.full(len(places), track.id)
    )
    pairs = [(i, j) for i in range(len(places)) for j in range(i) if group[i] == group[j]]
    moving = motion(places, np.array([speed, 0.0, 0.0]), sigma)
    nowhere = np.zeros(len(places), np.bool_)
    tracker.spawn(
        points,
        replace(moving, pairs=np.array(pairs)),
        nowhere,
        lambda _: 0.5,
        ObstacleParameters(),
    )


@pytest.mark.parametrize(
    ("speed", "begins"), [(0.9, True), (1.8, False)], ids=["with the body", "off its edge"]
)
def test_points_sliding_off_the_edge_do_not_make_a_body_rigid(
    make_track: MakeTrack, speed: float, begins: bool
) -> None:
    """Points that move like the outline show that such a low thing is rigid."""
    track = low_body(make_track)
    spawn_on(track, speed)
    assert track.rigid is begins


@pytest.mark.parametrize(
    ("state", "begins"), [(TrackState.TENTATIVE, True), (TrackState.CONFIRMED, False)]
)
def test_points_whose_motion_is_less_certain_do_not_replace_that_of_a_reported_body(
    make_track: MakeTrack, state: TrackState, begins: bool
) -> None:
    track = low_body(make_track)
    track.state = state
    spawn_on(track, 0.9, sigma=0.5)
    assert track.rigid is begins


def test_only_the_first_of_two_groups_on_a_body_gives_its_motion(make_track: MakeTrack) -> None:
    """The other one may as well be on its arm, or on what is behind it."""
    track = low_body(make_track)
    spawn_on(track, 0.9, at=(-0.08, 0.08))
    assert track.rigid
    assert track.mean[POSITION][0] == pytest.approx(-0.08, abs=0.02)
