"""The engine opens one source per simulator at a time: an open one is closed first."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator
from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.engine.calibrating import BoardPublisher
from app.engine.current_source import CurrentSource, Opening
from app.runtime.requests import Reply, Request
from observer.observer import Observer
from observer.opening import open_source

pytestmark = pytest.mark.usefixtures("extra")


class Desk:
    """The current source as an engine holds it, and the replies to its requests."""

    def __init__(self) -> None:
        self._done: queue.SimpleQueue[Opening] = queue.SimpleQueue()
        self.current = CurrentSource(
            open_source=open_source,
            make_observer=Observer,
            opened=self._done.put,
            closed=lambda: None,
            boards=BoardPublisher(lambda _: None, lambda *_: None, lambda: None),
            stage_clock=time.perf_counter,
        )

    def open(self, source: str, **more: Any) -> Reply | None:
        command = OpenSource(source, more.get("calibration"), {}, parameters_revision=1)
        self.current.begin(Request(1, command), command)
        return self.finished()

    def finished(self) -> Reply | None:
        return self.current.finish(self._done.get(timeout=20))

    def play(self, frames: int) -> list[float]:
        """Return the simulated times of the next frames."""
        session = self.current.session
        assert session is not None
        times = []
        for _ in range(frames):
            session.player.read_ahead()
            times.append(session.player.take(time.monotonic()).source_time)
        return times


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    yield desk
    desk.current.close()


def test_reopening_closes_the_source_first_and_restarts_it(shared: Any, desk: Desk) -> None:
    for _ in range(2):
        reply = desk.open(shared.spec)
        assert reply is not None
        assert reply.error is None
        assert reply.value.state.has_truth
        assert reply.value.state.playback.frame_count is None
        assert desk.play(3) == pytest.approx([0.0, 0.05, 0.1])


def test_a_refused_request_leaves_the_previous_source_open(shared: Any, desk: Desk) -> None:
    desk.open(shared.spec)
    refused = desk.open(shared.spec, calibration="nothing of the kind")
    assert refused is not None
    assert refused.error is not None
    desk.finished()
    assert desk.current.session is not None
    assert desk.play(2) == pytest.approx([0.0, 0.05])
