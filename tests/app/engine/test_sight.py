"""What the engine writes for the drive process, and what it takes from the wheel odometry."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from app.contract.commands import OpenSource
from app.contract.drive import SIGHT_NAME, WHEELS_NAME
from app.engine.observed import Observed
from app.engine.recorders import Recorders
from app.engine.session import Session, open_session
from app.engine.sight import SightWriter
from app.engine.wheel_feed import WheelFeed
from app.runtime.latest import LatestReader, LatestWriter, create_slot
from observer.errors import SourceError
from observer.guard.parameters import GuardParameters
from observer.guard.sight import REAL_WORLD, sight_of
from observer.navigation.parameters import AllParameters
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.parameters import Parameters
from observer.robots.contract import RobotPort
from observer.trace import FullTrace
from observer.types import Status, StereoFrame

WORLD = "simulated:drive:x"


class Slots:
    """Both slots, and a stopped clock."""

    def __init__(self) -> None:
        fds = [create_slot(1 << 16) for _ in (SIGHT_NAME, WHEELS_NAME)]
        self.sight = LatestReader(fds[0])
        self.wheels = LatestWriter(fds[1])
        self.ends = [LatestWriter(fds[0]), LatestReader(fds[1])]
        for fd in fds:
            os.close(fd)
        self.now = 100.0
        self.feed = WheelFeed(self.ends[1])  # type: ignore[arg-type]
        self.writer = SightWriter(self.ends[0], self.feed, lambda: self.now)  # type: ignore[arg-type]

    def drive(self, role: str = "observer", speed: float = 0.5) -> None:
        rows = [[self.now - 0.5 + 0.1 * k, speed * 0.1 * k, 0.0, 0.02 * k] for k in range(6)]
        self.wheels.write({role: rows})

    def read(self) -> Any:
        value = self.sight.read()
        return None if value is None else sight_of(value.header)

    def close(self) -> None:
        for end in (self.sight, self.wheels, *self.ends):
            end.close()


@pytest.fixture
def slots() -> Iterator[Slots]:
    made = Slots()
    yield made
    made.close()


def observed_frames(count: int, *, cover_from: int = 99) -> list[Observed]:
    opened = open_source("simulated:drive")
    assert opened.source.calibration is not None
    observer = Observer(opened.source.calibration, mount=opened.source.info.mount)
    found = []
    for k in range(count):
        frame = opened.source.read()
        assert isinstance(frame, StereoFrame)
        if k >= cover_from:
            black = np.random.default_rng(k).integers(0, 8, frame.left.shape).astype(np.uint8)
            frame = StereoFrame(frame.index, frame.time, black, black[::-1], frame.received)
        trace = FullTrace()
        observation = observer.observe(frame, trace)
        found.append(
            Observed(frame, observation, trace, observer.camera, observer.parameters, segment=0)
        )
    return found


MOUNT = open_source("simulated:drive").source.info.mount
GUARD = GuardParameters()


def test_every_frame_is_written_with_its_world_and_status(slots: Slots) -> None:
    for observed in observed_frames(2):
        slots.writer.write(observed, MOUNT, WORLD, GUARD)
        sight = slots.read()
        assert sight.frame == observed.frame.index
        assert sight.received == observed.frame.received
        assert sight.published == slots.now
        assert (sight.world, sight.mount_known) == (WORLD, True)
        assert sight.status is observed.observation.status
        # No wheel data have arrived.
        assert sight.scan is None


def test_free_floor_is_searched_only_while_a_robot_is_connected(slots: Slots) -> None:
    observed = observed_frames(2)[1]
    slots.drive()
    slots.writer.write(observed, MOUNT, WORLD, GUARD)
    scan = slots.read().scan
    free = [b for a, b in zip(scan.known_from_m, scan.known_to_m, strict=True) if b > a]
    assert len(free) > 0.7 * len(scan.bearings)
    # In a recording no robot is driven; without a mount the floor is unknown.
    slots.writer.write(observed, MOUNT, None, GUARD)
    assert slots.read().scan is None
    slots.writer.write(observed, None, WORLD, GUARD)
    assert (slots.read().mount_known, slots.read().scan) == (False, None)
    slots.now += 1.5
    slots.writer.write(observed, MOUNT, WORLD, GUARD)
    assert slots.read().scan is None


def test_a_covered_lens_is_reported_in_its_first_frame(slots: Slots) -> None:
    for observed in observed_frames(8, cover_from=6)[5:]:
        slots.drive()
        slots.writer.write(observed, MOUNT, WORLD, GUARD)
        sight = slots.read()
        if observed.frame.index < 6:
            assert sight.status is Status.OK
            continue
        assert sight.status is Status.LOST
        assert sight.reasons
        assert all(
            a == b for a, b in zip(sight.scan.known_from_m, sight.scan.known_to_m, strict=True)
        )


def test_odometry_is_interpolated_to_the_frame_time(slots: Slots) -> None:
    assert slots.feed.odometry(99.8) is None
    slots.drive()
    told = slots.feed.odometry(99.75)
    assert told is not None
    assert (told.x, told.y, told.yaw) == pytest.approx((0.125, 0.0, 0.05))
    # A frame arrives before the odometry report of its instant.
    onward = slots.feed.odometry(100.1)
    assert onward is not None
    assert onward.x == pytest.approx(0.3)
    assert slots.feed.odometry(100.3) is None
    assert slots.feed.odometry(99.4) is None
    slots.drive("obstacle")
    assert slots.feed.odometry(99.75) is None
    slots.wheels.write({"observer": "nonsense"})
    assert slots.feed.odometry(99.75) is None


def test_yaw_is_interpolated_across_the_wraparound(slots: Slots) -> None:
    slots.wheels.write({"observer": [[99.8, 0, 0, math.pi - 0.1], [99.9, 0, 0, 0.1 - math.pi]]})
    told = slots.feed.odometry(99.85)
    assert told is not None
    assert math.remainder(told.yaw - math.pi, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


# --- worlds and their robots -----------------------------------------------------------------


class Robots:
    """A world's robots, as far as a session uses them."""

    world = "simulated:numbers:1"

    def __init__(self, trouble: Exception | None = None) -> None:
        self.trouble = trouble
        self.served = self.closed = 0

    def serve(self) -> tuple[RobotPort, ...]:
        if self.trouble is not None:
            raise self.trouble
        self.served += 1
        return (RobotPort("observer", "socket://127.0.0.1:1", "amigo-sh", "A"),)

    def close(self) -> None:
        self.closed += 1


def session(source: Any, robots: Robots | None, opened: OpenedSource | None = None) -> Session:
    return open_session(
        OpenSource("numbers", None, {}, 0),
        lambda _: opened or OpenedSource(source, None, robots),
        Observer,
        time.perf_counter,
        Recorders(),
        lambda: None,
    )


def test_the_robots_of_a_world_are_served_while_it_is_observed(numbered: Any) -> None:
    robots, source = Robots(), numbered()
    opened = session(source, robots)
    assert opened.world == "simulated:numbers:1"
    port = RobotPort("observer", "socket://127.0.0.1:1", "amigo-sh", "A")
    assert opened.state(0.0).robots == (port,)
    opened.close()
    assert (robots.served, robots.closed, source.closed) == (1, 1, 1)


def test_a_source_whose_robots_cannot_be_served_is_closed(numbered: Any) -> None:
    robots, source = Robots(SourceError("no port is free")), numbered()
    with pytest.raises(SourceError, match="no port is free"):
        session(source, robots)
    assert (robots.closed, source.closed) == (1, 1)


@pytest.mark.parametrize(("live", "world"), [(True, REAL_WORLD), (False, None)])
def test_live_cameras_show_the_real_world_and_recordings_none(
    numbered: Any, live: bool, world: str | None
) -> None:
    opened = session(numbered(count=3, live=live), None)
    assert opened.world == world
    assert opened.state(0.0).robots == ()
    opened.close()


def test_robots_stay_with_a_source_that_is_handed_over(numbered: Any) -> None:
    robots, source = Robots(), numbered()
    old = session(source, robots)
    for taken_over in (False, True):
        new = session(source, robots, opened=old.lend())
        assert new.world == robots.world
        assert robots.served == 2 + taken_over
        if taken_over:
            new.take_over(old)
            old.close()
        assert (robots.closed, source.closed) == (0, 0)
        new.close()
        assert (robots.closed, source.closed) == (taken_over, taken_over)


def test_guard_parameters_do_not_affect_observation() -> None:
    changed = AllParameters().changed({"guard.speed_max_mps": 1.5, "guard.step_m": 0.2})
    assert changed.vision == Parameters()
    results = []
    for parameters in (Parameters(), changed.vision):
        opened = open_source("simulated:drive")
        assert opened.source.calibration is not None
        observer = Observer(opened.source.calibration, parameters, mount=opened.source.info.mount)
        for _ in range(4):
            frame = opened.source.read()
            assert isinstance(frame, StereoFrame)
            observation = observer.observe(frame)
        assert observation.T_world_camera is not None
        results.append((observation.status, observation.T_world_camera.matrix.tobytes()))
    assert results[0] == results[1]
