"""Obstacles while the pose is lost: no world position, a camera-relative one for a while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.reporting import describe_body
from observer.types import Obstacle, TrackState
from observer.vision.lifecycle import out_of_sight, while_lost, without_pose

MakeTrack = Callable[..., BodyTrack]
WORLD = ("position", "velocity", "position_cov", "velocity_cov", "orientation_wxyz")


def described(make_track: MakeTrack, state: TrackState) -> Obstacle:
    track = make_track((0.0, 0.0, 3.0), (0.3, 0.0, 0.0))
    track.state = state
    return describe_body(track, Pose.identity(), np.zeros(3), 2.0)


def test_world_quantities_are_unknown_without_a_pose(
    make_track: MakeTrack,
) -> None:
    known = described(make_track, TrackState.CONFIRMED)
    lost = without_pose(known)
    assert all(getattr(lost, name) is None for name in WORLD)
    assert lost.closing_speed is None
    assert (lost.id, lost.state, lost.speed) == (known.id, known.state, known.speed)
    assert lost.range == known.range


@pytest.mark.parametrize(
    ("state", "reported"),
    [
        (TrackState.CONFIRMED, TrackState.COASTING),
        (TrackState.COASTING, TrackState.COASTING),
        (TrackState.TENTATIVE, TrackState.TENTATIVE),
    ],
)
def test_confirmed_track_coasts_and_tentative_stays_tentative(
    make_track: MakeTrack, state: TrackState, reported: TrackState
) -> None:
    known = described(make_track, state)
    (lost,) = while_lost([(known, 0.1)], 0.4, 1.5)
    assert lost.state is reported
    assert lost.points == 0
    np.testing.assert_allclose(lost.position_camera, (0.12, 0, 3), atol=1e-12)
    assert lost.velocity_time == 2.0
    assert lost.reason.count("not seen for") == 1


def test_unseen_body_has_no_silhouette(make_track: MakeTrack) -> None:
    known = described(make_track, TrackState.CONFIRMED)
    seen = replace(known, silhouette=(np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]]),))
    (lost,) = while_lost([(seen, 0.0)], 0.1, 1.0)
    assert lost.silhouette is None


def test_track_unseen_for_too_long_is_dropped(make_track: MakeTrack) -> None:
    known = described(make_track, TrackState.COASTING)
    assert len(while_lost([(known, 1.0), (known, 1.2)], 0.4, 1.5)) == 1
    assert while_lost([], 0.4, 1.5) == ()


def test_out_of_sight_reason_states_the_duration() -> None:
    reason = out_of_sight(1.26, "it drove off")
    assert reason == "not seen for 1.3 s, position predicted; it drove off"
