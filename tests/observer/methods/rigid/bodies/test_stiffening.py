"""When points on a supposed person turn it into a rigid body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.parameters import ObstacleParameters
from observer.vision.lifecycle import NO_OBSTACLE

from ..moving_points import motion
from ..solid_worlds import Solid, outline_of, patch, points_on

MakeTrack = Callable[..., BodyTrack]


@pytest.mark.parametrize(
    ("speed", "begins"), [(0.9, True), (1.8, False)], ids=["with the body", "off its edge"]
)
def test_points_sliding_off_the_edge_do_not_make_a_body_rigid(
    make_track: MakeTrack, speed: float, begins: bool
) -> None:
    """Points that move like the outline show that such a low thing is rigid."""
    track = make_track((0.0, 0.0, 3.95), (0.9, 0.0, 0.0), sigma=0.03)
    track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.6, 0.5, 0.1)))
    track.rigid = False
    tracker = BodyTracker()
    tracker.tracks.append(track)
    places = patch(0.1, 0.0, 3.95)
    points = points_on(places).but(
        obstacle=np.full(len(places), NO_OBSTACLE), within=np.full(len(places), track.id)
    )
    pairs = np.array([(i, j) for i in range(len(places)) for j in range(i)])
    moving = replace(motion(places, np.array([speed, 0.0, 0.0])), pairs=pairs)
    nowhere = np.zeros(len(places), np.bool_)
    tracker.spawn(points, moving, nowhere, lambda _: 0.5, ObstacleParameters())
    assert track.rigid is begins
