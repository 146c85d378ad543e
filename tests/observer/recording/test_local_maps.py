"""Recorded local maps alongside the frames: how long each counts, and the robot's place in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.occupancy import HELD_S, OccupancyMap
from observer.opening import open_source
from observer.recording.local_maps import MapInForce, maps_by_frame, maps_in_force
from observer.recording.payloads import LocalMapPayload, RunFacts
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

ROBOT = (0.5, 0.2, 0.3)
Write = Callable[..., Path]


def map_at(received: float) -> OccupancyMap:
    return OccupancyMap.of(np.ones((3, 3), np.uint8), (0.0, 0.0), 0.1, ROBOT, received)


@pytest.fixture
def write(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts], line: Any
) -> Write:
    """Write the frames, 1/15 s apart, with maps at some of them."""

    def write(at: set[int], begins: int | None = None, unobserved: tuple[int, ...] = ()) -> Path:
        path = tmp_path / "recording.mcap"
        writer = RecordingWriter(path, facts("jpeg"))
        for k, frame in enumerate(frames):
            writer.frame(frame, begins="segment" if k == begins else None)
            if k not in unobserved:
                writer.observation(line(frame), frame.received)
            if k in at:
                told = map_at(frame.received)
                writer.local_map(LocalMapPayload(frame=frame.index, time=frame.time, map=told))
        writer.finish()
        return path

    return write


def ranges(path: Path) -> list[tuple[int, int]]:
    with Recording(path) as recording:
        return [(one.positions.start, one.positions.stop) for one in maps_in_force(recording)]


def test_a_map_applies_until_the_next_one_or_until_it_is_too_old(
    write: Write, frames: tuple[StereoFrame, ...]
) -> None:
    held = 1 + sum(0 < one.received - frames[7].received <= HELD_S for one in frames)
    assert held < len(frames) - 7
    assert ranges(write({0, 7})) == [(0, 7), (7, 7 + held)]
    assert ranges(write(set())) == []


def test_a_map_whose_frame_is_missing_applies_nowhere(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts]
) -> None:
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, facts("none"))
    writer.frame(frames[0])
    told = map_at(frames[1].received)
    writer.local_map(LocalMapPayload(frame=frames[1].index, time=frames[1].time, map=told))
    writer.finish()
    assert ranges(path) == []


def test_a_map_does_not_apply_beyond_its_segment(write: Write) -> None:
    assert ranges(write({5}, begins=8)) == [(5, 8)]


def test_the_robot_is_placed_in_the_map_at_each_frame(write: Write) -> None:
    path = write({2}, unobserved=(4,))
    with Recording(path) as recording:
        maps = maps_by_frame(recording)
        ahead = [frame.time - recording.frames[2].time for frame in recording.frames]
    assert 4 not in maps
    assert maps[2].robot == pytest.approx(ROBOT)
    # The lines report 0.1 m/s along the optical axis, which is tilted slightly.
    x, y, yaw = ROBOT
    distance = 0.1 * ahead[6]
    expected = (x + distance * math.cos(yaw), y + distance * math.sin(yaw), yaw)
    assert maps[6].robot == pytest.approx(expected, abs=1e-3)
    opened = open_source(str(path))
    assert opened.local_maps == maps
    opened.source.close()


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_cell_stays_where_it_was_seen(
    begin: tuple[float, float, float], now: tuple[float, float, float]
) -> None:
    poses = [Pose.from_rotvec([0.0, 0.0, yaw], [x, y, 0.1]) for x, y, yaw in (begin, now)]
    one = MapInForce(map_at(0.0), range(2), dict(enumerate(poses)))
    placed = one.at(1)
    assert placed is not None
    cell = [0.2, 0.1, 0.0]
    np.testing.assert_allclose(
        placed.placed(poses[1]).apply(cell), one.map.placed(poses[0]).apply(cell), atol=1e-6
    )
