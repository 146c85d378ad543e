"""Identities over time: started, confirmed, coasting, ended, kept apart."""

from __future__ import annotations

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.planar.results import Detection, Track
from observer.methods.planar.tracking import Tracker
from observer.parameters import TrackingParameters
from observer.types import TrackState
from observer.vision.lifecycle import TrackIds

DT = 1 / 15
HERE = Pose.identity()


def detection(
    position: tuple[float, float, float], velocity: tuple[float, float, float] = (0, 0, 0)
) -> Detection:
    return Detection(
        position=np.array(position, float),
        position_cov=np.eye(3) * 1e-4,
        velocity=np.array(velocity, float),
        velocity_cov=np.eye(3) * 1e-2,
        velocity_time=0.0,
        size=np.full(3, 0.3),
        points=10,
        significance=5.0,
        box_px=(0.0, 0.0, 1.0, 1.0),
    )


class Run:
    """A tracker that is fed frame by frame."""

    def __init__(self, **parameters: float) -> None:
        self.numbers = TrackIds()
        self.tracker = Tracker(self.numbers)
        self.parameters = TrackingParameters(**parameters)
        self.time = 0.0

    def see(self, *detections: Detection, pose: Pose = HERE, dt: float = DT) -> tuple[Track, ...]:
        self.time += dt
        return self.tracker.update(detections, pose, self.time, self.parameters)


def test_a_track_is_confirmed_after_the_configured_number_of_sightings() -> None:
    run = Run(confirm_hits=3)
    states = [run.see(detection((0, 0, 2)))[0].state for _ in range(4)]
    tentative, confirmed = TrackState.TENTATIVE, TrackState.CONFIRMED
    assert states == [tentative, tentative, confirmed, confirmed]
    assert Run(confirm_hits=1).see(detection((0, 0, 2)))[0].state is confirmed


def test_the_velocity_is_that_of_the_latest_displacement_only() -> None:
    run = Run()
    for speed in (0.1, 0.9, -0.3):
        (track,) = run.see(detection((0, 0, 2), (speed, 0, 0)))
        np.testing.assert_allclose(track.velocity, (speed, 0, 0))


def test_two_crossing_tracks_keep_their_identities() -> None:
    run = Run(gate=0.6, confirm_hits=1)
    path = np.arange(-1.0, 1.0, 0.5 * DT)
    numbers = set()
    for s in path:
        a, b = detection((s, 0, 2), (0.5, 0, 0)), detection((-s, 0, 2.3), (-0.5, 0, 0))
        first, second = (a, b) if int(s * 100) % 2 else (b, a)
        tracks = {t.id: t.detection.velocity[0] > 0 for t in run.see(first, second)}
        assert len(tracks) == 2
        numbers.add(tuple(sorted(tracks.items())))
    assert len(numbers) == 1


def test_a_confirmed_track_coasts_along_its_path_and_then_ends() -> None:
    run = Run(coast_frames=4)
    for k in range(6):
        tracks = run.see(detection((0.5 * DT * k, 0, 2), (0.5, 0, 0)))
    before = tracks[0]
    for missed in range(1, 5):
        (track,) = run.see()
        assert track.state is TrackState.COASTING
        assert track.id == before.id
        assert track.missed == missed
        expected = before.position + np.array([0.5 * DT * missed, 0, 0])
        np.testing.assert_allclose(track.position, expected, atol=1e-6)
    assert run.see() == ()


def test_a_coasting_track_is_found_again() -> None:
    run = Run(coast_frames=5)
    for k in range(5):
        (seen,) = run.see(detection((0.5 * DT * k, 0, 2), (0.5, 0, 0)))
    for _ in range(3):
        run.see()
    (again,) = run.see(detection((0.5 * DT * 8, 0, 2), (0.5, 0, 0)))
    assert again.id == seen.id
    assert again.state is TrackState.CONFIRMED
    assert again.missed == 0


def test_a_tentative_track_ends_after_two_misses() -> None:
    run = Run(coast_frames=30)
    (track,) = run.see(detection((0, 0, 2)))
    (still,) = run.see()
    assert still.id == track.id
    assert still.state is TrackState.TENTATIVE
    assert run.see() == ()


def test_a_new_track_starts_beyond_the_gate() -> None:
    run = Run(gate=0.3, confirm_hits=1)
    (first,) = run.see(detection((0, 0, 2)))
    (near,) = run.see(detection((0.25, 0, 2)))
    assert near.id == first.id
    tracks = run.see(detection((1.0, 0, 2)))
    assert sorted(t.state for t in tracks) == [TrackState.COASTING, TrackState.CONFIRMED]
    assert len({t.id for t in tracks}) == 2


def test_a_static_obstacle_keeps_its_identity_while_the_camera_moves() -> None:
    run = Run(gate=0.1, confirm_hits=1)
    numbers = set()
    for k in range(10):
        pose = Pose.from_rotvec((0, 0.1 * k, 0), (0.3 * k, 0, 0))
        seen = detection(tuple(pose.inverse().apply((1.0, 0, 5.0))))
        (track,) = run.see(seen, pose=pose)
        np.testing.assert_allclose(track.position, (1, 0, 5), atol=1e-9)
        numbers.add(track.id)
    assert len(numbers) == 1


def test_numbers_are_not_reused() -> None:
    run = Run(confirm_hits=1)
    (first,) = run.see(detection((0, 0, 2)))
    run.tracker = Tracker(run.numbers)
    (second,) = run.see(detection((0, 0, 2)))
    assert second.id > first.id
    assert second.sightings == 1


def test_provisional_numbers_are_not_reused_either() -> None:
    run = Run(confirm_hits=3)
    (first,) = run.see(detection((0, 0, 2)))
    run.tracker = Tracker(run.numbers)
    (second,) = run.see(detection((0, 0, 2)))
    assert second.id < first.id < 0


def test_only_confirmed_tracks_use_up_a_number() -> None:
    run = Run(confirm_hits=3)
    fleeting = set()
    for k in range(9):  # Each is too far from the last one to be the same.
        fleeting |= {t.id for t in run.see(detection((3.0 * k, 0, 2)))}
    assert len(fleeting) == 9
    assert max(fleeting) < -1  # -1 means no obstacle.
    place = detection((0, 5, 2))
    numbers = [run.see(place)[-1].id for _ in range(5)]
    assert numbers[0] == numbers[1] < min(fleeting)
    assert numbers[2:] == [1, 1, 1]
    (coasting,) = run.see()
    assert coasting.id == 1


@pytest.mark.parametrize("dt", [0.02, 0.5])
def test_the_expected_position_of_a_track_accounts_for_elapsed_time(dt: float) -> None:
    run = Run(gate=0.05, confirm_hits=1)
    numbers = {run.see(detection((0.8 * dt * k, 0, 2), (0.8, 0, 0)), dt=dt)[0].id for k in range(5)}
    assert len(numbers) == 1
