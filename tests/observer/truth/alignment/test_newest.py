"""Clocks from arrivals, and motion capture reported right after it was measured."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.geometry import Pose
from observer.truth.alignment.alignment import align
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.live_clocks import LiveClocks, SourceClock
from observer.truth.alignment.newest import NewestTruth, TimedBody
from observer.truth.alignment.observed import ObservedRun
from observer.truth.alignment.result import Alignment
from observer.truth.live.clock import ClockFit
from observer.truth.motion_capture import BodySample

from .conftest import to_source

SAME = ClockFit(0.0, 0.0, 0.0, 1, 0.0, 1.0)


def samples_of(room: Any) -> list[BodySample]:
    """Return samples in order of arrival, on the room's own clock."""
    known = [
        BodySample(name, float(t), float(t), p if np.isfinite(p).all() else None,
                   R if np.isfinite(R).all() else None)
        for name, body in room.capture.bodies.items()
        for t, p, R in zip(body.times, body.positions, body.rotations, strict=True)
    ]  # fmt: skip
    return sorted(known, key=lambda sample: sample.time)


@pytest.fixture(scope="module")
def found(room: Any, mount: Any) -> Alignment:
    return align(ObservedRun.of_lines(room.lines), room.capture, AlignmentChoices(mount=mount))


def bodies_at(
    room: Any, found: Alignment, time: float, *, until: float | None = None, at_least: float = -9.0
) -> dict[str, TimedBody]:
    """Return the bodies at ``time`` given samples up to ``until``, both on the source's clock."""
    newest = NewestTruth()
    limit = (time if until is None else until) - room.offset
    newest.add(s for s in samples_of(room) if at_least - room.offset <= s.time <= limit)
    known = newest.bodies(found, LiveClocks(SAME, SAME), found.T_world_room[0], time)
    return {each.body.name: each for each in known}


def test_clocks_are_chained_in_both_directions() -> None:
    # The server started 1000 s before the host and is slow; the source started 10 s after it.
    server = ClockFit(-1000.0, 50.0, 0.0, 100, 1500.0, 60.0)
    source = ClockFit(10.0, -20.0, 0.0, 100, 480.0, 60.0)
    clocks = LiveClocks(server, source)
    stamps = np.array([1500.0, 1510.0, 1600.0])
    expected = [source.to_server(server.to_host(s)) for s in stamps]
    np.testing.assert_allclose(clocks.to_source(stamps), expected, atol=1e-7)
    np.testing.assert_allclose(clocks.to_server(clocks.to_source(stamps)), stamps, atol=1e-7)
    assert server.to_server(server.to_host(1534.5)) == pytest.approx(1534.5)


def test_paused_source_gets_a_new_clock() -> None:
    clock = SourceClock()
    rng = np.random.default_rng(1)
    times = np.arange(0, 8, 1 / 15)
    assert not any(clock.add(t, 500.0 + t + rng.exponential(0.005)) for t in times)
    fit = clock.fit()
    assert fit is not None
    assert fit.to_host(4.0) == pytest.approx(504.0, abs=0.003)
    # A delay that it catches up on is not a restart.
    assert not any(clock.add(8 + k / 15, 508.0 + max(k / 15, 0.8)) for k in range(40))
    # A pause of two seconds is.
    later = [clock.add(11 + k / 15, 513.0 + k / 15) for k in range(45)]
    assert sum(later) == 1
    fit = clock.fit()
    # It restarts only once the pause can be distinguished from a delay.
    assert fit is None or fit.to_host(12.0) == pytest.approx(514.0, abs=0.01)
    assert clock.add(3.0, 520.0)


def test_bodies_are_reported_as_measured(room: Any, found: Alignment) -> None:
    places, speeds = [], []
    for time in np.arange(2.5, 24, 0.37):
        known = bodies_at(room, found, time, until=time + 0.1)
        if "P3DX" in known:
            body = known["P3DX"].body
            assert known["P3DX"].time == time
            assert (body.id, body.role, body.visible, body.commanded_speed) == (
                1, "obstacle", None, None,
            )  # fmt: skip
            places.append(np.linalg.norm(body.position - room.centre(time)))
            speeds.append(abs(body.speed - room.speed(time)))
    assert len(places) > 45
    assert np.median(places) < 0.05
    assert np.median(speeds) < 0.015


def test_samples_not_yet_received_are_not_extrapolated(room: Any, found: Alignment) -> None:
    known = bodies_at(room, found, 10.0, until=9.97)["P3DX"]
    # It lags by three samples, at 100 Hz.
    assert 9.90 < known.time < 9.95
    assert known.body.speed == pytest.approx(room.speed(known.time), abs=0.06)
    assert bodies_at(room, found, 10.0, until=9.85) == {}
    newest = NewestTruth()
    newest.add(s for s in samples_of(room) if s.time <= 9.9 - room.offset)
    clocks, T = LiveClocks(SAME, SAME), found.T_world_room[0]
    assert len(newest.bodies(found, clocks, T, 9.9)) == 2
    # The next frame comes before any new sample: no instant is reported twice.
    assert newest.bodies(found, clocks, T, 9.92) == ()


def test_gap_remains_a_gap(room: Any, found: Alignment) -> None:
    body = room.capture.bodies["P3DX"]
    lost = body.times[~body.seen]
    middle = float(to_source(found.time, lost[12:13])[0])
    assert "P3DX" not in bodies_at(room, found, middle, until=middle + 0.2)
    # Likewise when the server falls silent and resumes.
    for time, there in ((10.0, True), (10.2, False), (10.5, False), (10.7, True)):
        newest = NewestTruth()
        for sample in samples_of(room):
            at = sample.time + room.offset
            if at <= time + 0.1 and not 10.05 < at < 10.55:
                newest.add([sample])
        known = newest.bodies(found, LiveClocks(SAME, SAME), found.T_world_room[0], time)
        assert ("P3DX" in {each.body.name for each in known}) == there, time


def test_camera_pose_follows_its_body(room: Any, found: Alignment) -> None:
    newest = NewestTruth()
    newest.add(s for s in samples_of(room) if s.time <= 10.1 - room.offset)
    clocks = LiveClocks(SAME, SAME)
    camera = newest.room_camera(found, clocks, 10.0)
    assert camera is not None
    line = room.lines[150]
    assert line["time"] == pytest.approx(10.0)
    seen = Pose.from_quaternion(line["pose"]["orientation_wxyz"], line["pose"]["position"])
    T_world_room = seen @ camera.inverse()
    apart = T_world_room.inverse() @ found.T_world_room[0]
    assert np.linalg.norm(apart.translation) < 0.1
    assert np.degrees(np.linalg.norm(apart.rotvec)) < 1.5
    assert newest.room_camera(found, clocks, 11.0) is None
    assert newest.room_camera(replace(found, T_body_camera=None), clocks, 10.0) is None
