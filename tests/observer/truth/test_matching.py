"""Truth matched to reports, with bodies at chosen places."""

from __future__ import annotations

import numpy as np
import pytest

from observer.geometry import Pose
from observer.truth.contract import TrueBody
from observer.truth.matching import TrueBodyEntry, TruthMatcher
from observer.types import Observation, Obstacle, Status, TrackState

from ..builders import an_obstacle


class Bodies:
    def __init__(self, *bodies: TrueBody, T_world_camera: Pose | None) -> None:
        self._bodies = bodies
        self._pose = T_world_camera

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        del time
        return self._bodies

    def camera_pose(self, time: float) -> Pose | None:
        del time
        return self._pose


def body(number: int, position: list[float], role: str = "obstacle") -> TrueBody:
    velocity, size = np.array([0.3, 0.0, 0.4]), np.array([0.4, 0.4, 0.3])
    return TrueBody(number, f"b{number}", role, np.array(position), velocity, size, 0.5, 1.0, 0.5)


def obstacle(
    number: int, position: list[float] | None, state: TrackState = TrackState.CONFIRMED
) -> Obstacle:
    at = None if position is None else np.array(position)
    return an_obstacle(id=number, state=state, position=at, velocity=at)


def observation(
    *obstacles: Obstacle, pose: Pose | None = None, segment: int = 0, frame: int = 5
) -> Observation:
    pose = pose or Pose.identity()
    return Observation(frame, 0.5, 0.0, segment, Status.OK, (), 1, pose, obstacles)


def tracks(entries: list[TrueBodyEntry]) -> dict[int, int | None]:
    return {entry["id"]: entry["track_id"] for entry in entries}


def test_each_body_gets_the_nearest_track_and_each_track_one_body() -> None:
    matcher = TruthMatcher(
        Bodies(body(1, [0, 0, 3]), body(2, [1, 0, 3]), T_world_camera=Pose.identity())
    )
    entries = matcher.match(observation(obstacle(7, [0.6, 0, 3]), obstacle(8, [1.1, 0, 3])), 0.5)
    assert tracks(entries) == {1: 7, 2: 8}
    assert entries[0]["speed"] == pytest.approx(0.5)
    assert entries[0]["position"] == pytest.approx([0, 0, 3])


def test_distant_tentative_or_unlocated_tracks_do_not_match() -> None:
    matcher = TruthMatcher(Bodies(body(1, [0, 0, 3]), T_world_camera=Pose.identity()))
    for wrong in (
        obstacle(1, [0, 0, 4.3]),
        obstacle(2, None),
        obstacle(3, [0, 0, 3], TrackState.TENTATIVE),
    ):
        assert tracks(matcher.match(observation(wrong), 0.5)) == {1: None}
    assert tracks(matcher.match(observation(obstacle(4, [0, 0, 4.1])), 0.5)) == {1: 4}


def test_observer_is_listed_but_never_matched() -> None:
    matcher = TruthMatcher(Bodies(body(1, [0, 0, 3], "observer"), T_world_camera=Pose.identity()))
    entries = matcher.match(observation(obstacle(1, [0, 0, 3])), 0.5)
    assert [(e["role"], e["track_id"]) for e in entries] == [("observer", None)]


def test_truth_is_transformed_into_the_segments_world_frame() -> None:
    # The segment began with the camera at x = 2, looking along the world's +x.
    there = Pose.from_rotvec([0, np.pi / 2, 0], [2.0, 0, 0])
    matcher = TruthMatcher(Bodies(body(1, [5.0, 0, 0]), T_world_camera=there))
    entries = matcher.match(observation(obstacle(3, [0.1, 0, 3.0]), segment=2), 9.0)
    assert tracks(entries) == {1: 3}
    assert entries[0]["position"] == pytest.approx([0, 0, 3])
    # Velocity (0.3, 0, 0.4) turned by -90 degrees about y.
    assert entries[0]["velocity"] == pytest.approx([-0.4, 0, 0.3])
    assert entries[0]["yaw"] == pytest.approx(0.5 - np.pi / 2)


def test_segment_alignment_is_fixed_so_that_drift_shows() -> None:
    matcher = TruthMatcher(Bodies(body(1, [0, 0, 3]), T_world_camera=Pose.identity()))
    matcher.match(observation(), 0.5)
    drifted = Pose(np.eye(3), np.array([0.2, 0, 0]))
    entries = matcher.match(observation(pose=drifted), 0.6)
    assert entries[0]["position"] == pytest.approx([0, 0, 3])
    entries = matcher.match(observation(pose=drifted, segment=1), 0.7)
    assert entries[0]["position"] == pytest.approx([0.2, 0, 3])


def test_only_a_segment_that_begins_with_frame_0_has_truth_without_a_true_camera_pose() -> None:
    truth = Bodies(body(1, [0, 0, 3]), T_world_camera=None)
    matcher = TruthMatcher(truth)
    assert len(matcher.match(observation(frame=0), 0.0)) == 1
    assert len(matcher.match(observation(frame=5), 0.5)) == 1
    assert matcher.match(observation(segment=1), 0.6) == []
    assert TruthMatcher(truth).match(observation(frame=5), 0.5) == []
