"""The local map in force, of a goal's planner or of a recording: sent when it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.engine.local_maps import LocalMaps
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.occupancy import HELD_S, OccupancyMap

MOUNT = CameraMount(0.5, 0.2, 0.1, 0.0)
ROBOT = (1.0, 2.0, 0.5)
HERE = Pose.identity()


def map_at(received: float) -> OccupancyMap:
    return OccupancyMap.of(np.ones((3, 3), np.uint8), (1.0, 2.0), 0.1, ROBOT, received)


def test_a_map_is_sent_with_its_pose_below_the_cameras() -> None:
    made = map_at(7.0)
    event = LocalMaps({}, MOUNT).next_event(made, 0, 0, 7.0, HERE)
    assert event is not None
    assert event.map is made
    assert event.T_world_corner is not None
    # The corner is at the robot, on the ground: behind the camera and below it.
    in_base = MOUNT.T_base_camera.apply(event.T_world_corner.translation)
    np.testing.assert_allclose(in_base, [0.0, 0.0, 0.0], atol=1e-9)


def test_a_map_is_cleared_when_it_is_too_old_or_of_another_segment() -> None:
    maps = LocalMaps({}, MOUNT)
    assert maps.next_event(None, 0, 0, 6.9, HERE) is None
    maps.next_event(map_at(7.0), 0, 0, 7.0, HERE)
    assert maps.next_event(None, 0, 0, 7.0 + 0.9 * HELD_S, HERE) is None
    gone = maps.next_event(None, 0, 0, 7.0 + 1.1 * HELD_S, HERE)
    assert gone is not None
    assert gone.map is None
    assert maps.next_event(None, 0, 0, 9.0, HERE) is None
    maps.next_event(map_at(9.1), 0, 0, 9.1, HERE)
    other = maps.next_event(None, 0, 1, 9.2, HERE)
    assert other is not None
    assert other.map is None


@pytest.mark.parametrize(("mount", "pose"), [(None, HERE), (MOUNT, None)])
def test_no_map_is_sent_without_a_pose(mount: CameraMount | None, pose: Pose | None) -> None:
    assert LocalMaps({}, mount).next_event(map_at(7.0), 0, 0, 7.0, pose) is None


def test_a_recorded_map_is_sent_once_at_the_frame_it_took_effect() -> None:
    # On a clock unrelated to the present one.
    first, second = map_at(1e6), map_at(1e6 + 0.5)
    moved = replace(first, robot=(1.1, 2.0, 0.5))
    maps = LocalMaps({3: first, 4: moved, 5: second}, MOUNT)
    told = {k: maps.next_event(None, k, 0, 0.1 * k, HERE) for k in range(8)}
    shown = {k: None if event.map is None else event.map for k, event in told.items() if event}
    assert shown == {3: first, 5: second, 6: None}
    # After a seek into the middle, the robot has the pose of that frame.
    event = maps.next_event(None, 4, 1, 0.9, HERE)
    assert event is not None
    assert event.map is moved
