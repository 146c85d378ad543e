"""Motion capture drops out while a robot drives: robots do not depend on ground truth.

``tests/app/engine/test_live_truth`` covers the resulting gap in the chart. ``FAULT_TRIALS``
trials, with our own motion-capture server over real TCP.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import pytest

from observer.geometry import Pose

from ..observer.truth.live.mishaps import Mishaps, Sent, Stream
from ..observer.truth.live.vrpn_server import VrpnServer
from .bench import TRIALS, tell, wait_until
from .system import System

DROPPED_S = 1.0
# A busy machine occasionally stops a robot for other reasons, so a drop-out counts only right
# after an equally long time in which the robot kept driving.
_TRIES = 6

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120 + 30 * TRIALS)]


class MotionCapture:
    """A motion-capture server with two bodies at 100 Hz, and ways in which it fails."""

    def __init__(self) -> None:
        self._server = VrpnServer(["Amigo", "P3DX"])
        self.port = self._server.port
        self._mishaps = Mishaps(offset_s=1e9, since=time.monotonic())
        self._silent = self._gone = False
        self._stream = Stream(_poses, self._send, self._mishaps, rate_hz=100.0)

    def _send(self, sent: list[Sent]) -> None:
        if not self._silent:
            self._server.send(sent)

    def falls_silent(self) -> None:
        self._silent = True

    def sees_nothing(self) -> None:
        self._mishaps.unseen = 1.0

    def drops_connections(self) -> None:
        self._server.drop_clients()

    def is_gone(self) -> None:
        """Stop listening: connections are refused from now on."""
        self._gone = True
        self._server.stop()

    def comes_back(self) -> None:
        self._silent, self._mishaps.unseen = False, 0.0
        if self._gone:
            self._gone = False
            self._server = VrpnServer(["Amigo", "P3DX"], port=self.port)

    def end(self) -> None:
        self._stream.stop()
        self._server.stop()


def _poses(now: float) -> dict[str, Pose | None]:
    return {
        name: Pose.from_rotvec([0, 0, 0.1], [number + 0.2 * (now % 1.0), 0.5, 0.1])
        for number, name in enumerate(("Amigo", "P3DX"))
    }


@pytest.fixture(scope="module")
def capture() -> Iterator[MotionCapture]:
    made = MotionCapture()
    yield made
    made.end()


@pytest.mark.patient
def test_motion_capture_drops_out(system: System, capture: MotionCapture) -> None:
    system.server.request("PUT", "/truth/live", {"spec": f"vrpn:127.0.0.1:{capture.port}"})

    def told(state: str) -> Callable[[], Any]:
        return lambda: system.server.request("GET", "/truth/live")["state"] == state

    ways = (capture.falls_silent, capture.is_gone, capture.drops_connections, capture.sees_nothing)
    calm: list[float] = []
    dropped: list[float] = []
    for trial in range(max(TRIALS, 2)):
        way = ways[trial % len(ways)]
        stops: list[Any] = []
        for _ in range(_TRIES):
            wait_until("motion capture is received", told("receiving"), 20.0)
            system.move()
            pause, stopped = _driving(system)
            if stopped:
                continue
            calm.append(pause)
            way()
            pause, stopped = _driving(system)
            if trial % len(ways) < 2:
                wait_until("it is told", lambda: not told("receiving")(), 10.0)
            capture.comes_back()
            if not stopped:
                dropped.append(pause)
                break
            stops.append(system.server.request("GET", "/robots")["incidents"][-1:])
        else:
            if len(stops) < 2:
                pytest.skip("this machine stops the robot by itself, it is too busy")
            pytest.fail(f"the robot was stopped while motion capture {way.__name__}: {stops}")
    tell(
        f"fault 11, motion capture drops out: robot driven on in {len(dropped)} of "
        f"{len(dropped)}, longest pause between its commands {1000 * max(dropped):.0f} ms, "
        f"{1000 * max(calm):.0f} ms without"
    )


def _driving(system: System) -> tuple[float, bool]:
    """Return, for the next ``DROPPED_S``, the longest pause between two commands on the robot's
    port, and whether one of them stopped it."""
    began = time.monotonic()
    time.sleep(DROPPED_S)
    came = system.robot.robot.log.since(began)
    times = [began, *(each.time for each in came), time.monotonic()]
    return max(b - a for a, b in pairwise(times)), any(each.is_standstill for each in came)
