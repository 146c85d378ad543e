"""Only one program can open a camera: sessions hand it over instead of opening it again."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.contract.commands import BeginCalibration, OpenSource
from app.contract.events import EngineState
from app.engine.calibrating import BoardPublisher
from app.engine.current_source import CurrentSource, Opening
from app.engine.live_truth import LiveTruth, ObservedSource
from app.runtime.requests import Reply, Request
from observer.calibration.boards.board import Board
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.observer import Observer
from observer.opening import OpenedSource
from observer.sources.contract import LiveReport, SourceInfo
from observer.types import StereoFrame

from ...waiting import until

WIDTH, HEIGHT = 64, 48
SPEC, SWAPPED = "camera:0,1", "camera:1,0"


def calibration(width: int = WIDTH) -> str:
    return calibration_text(StereoCalibration.rectified(width, HEIGHT, 60.0, 60.0, 32.0, 24.0, 0.1))


class Cameras:
    """Two devices; opening them while they are open is refused, as by a driver."""

    def __init__(self) -> None:
        self.open = 0
        self.opened: list[str] = []
        self.gone = False

    def source(self, spec: str) -> OpenedSource:
        if spec == "numbers":
            return OpenedSource(Camera(None, spec), None)
        if self.gone:
            raise SourceError("the left camera (/dev/video0) is gone")
        if self.open:
            raise SourceError("the left camera (/dev/video0) is in use")
        self.open += 1
        self.opened.append(spec)
        return OpenedSource(Camera(self, spec), None)


class Camera:
    calibration = None

    def __init__(self, cameras: Cameras | None, spec: str) -> None:
        self._cameras = cameras
        self._spec = spec
        self._index = 0
        self.closed = False

    @property
    def info(self) -> SourceInfo:
        devices = ("/dev/video0", "/dev/video1") if self._cameras else ()
        return SourceInfo(
            self._spec, "camera", WIDTH, HEIGHT, 30.0, None, live=True, devices=devices
        )

    def read(self) -> StereoFrame:
        assert not self.closed, "a closed camera was read"
        self._index += 1
        image = np.full((HEIGHT, WIDTH), self._index % 256, np.uint8)
        now = time.monotonic()
        return StereoFrame(self._index, now, image, image, now)

    def rewind(self) -> None:
        raise SourceError("a live source cannot be rewound")

    def tend(self) -> None:
        assert not self.closed, "a closed camera was tended"

    def report(self) -> LiveReport:
        return LiveReport((), self._index, 0, None, None, 0)

    def close(self) -> None:
        if not self.closed and self._cameras:
            self._cameras.open -= 1
        self.closed = True


class Truth(LiveTruth):
    """Remembers the source that it was last told of."""

    source: ObservedSource | None = None

    def observing(self, source: ObservedSource | None) -> None:
        self.source = source
        super().observing(source)


class Desk:
    """The current session, and the answers to requests."""

    def __init__(self, cameras: Cameras) -> None:
        self.done: queue.SimpleQueue[Opening] = queue.SimpleQueue()
        self.truth = Truth()
        self.current = CurrentSource(
            open_source=cameras.source,
            make_observer=Observer,
            opened=self.done.put,
            closed=lambda: None,
            boards=BoardPublisher(lambda _: None, lambda *_: None, lambda: None),
            stage_clock=time.perf_counter,
            truth=self.truth,
        )
        self._number = 0

    def ask(self, command: OpenSource | BeginCalibration) -> Reply | None:
        self._number += 1
        self.current.begin(Request(self._number, command), command)
        return self.finished()

    def finished(self) -> Reply | None:
        return self.current.finish(self.done.get(timeout=10))


@pytest.fixture
def cameras() -> Cameras:
    return Cameras()


@pytest.fixture
def desk(cameras: Cameras) -> Any:
    desk = Desk(cameras)
    yield desk
    desk.current.close()
    assert cameras.open == 0


def observed(spec: str = SPEC, text: str | None = None) -> OpenSource:
    return OpenSource(spec, text or calibration(), {}, parameters_revision=1)


CALIBRATING = BeginCalibration(SPEC, Board())


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (observed(), CALIBRATING),
        (CALIBRATING, observed()),
        (observed(), observed()),
        (CALIBRATING, CALIBRATING),
    ],
)
def test_the_same_cameras_are_handed_over_and_never_opened_twice(
    desk: Desk, cameras: Cameras, first: Any, second: Any
) -> None:
    for command in (first, second, first, second):
        reply = desk.ask(command)
        assert reply is not None
        assert reply.error is None
        assert cameras.open == 1
    assert cameras.opened == [SPEC]
    until(
        lambda: sum(thread.name == "recording" for thread in threading.enumerate()) <= 1,
        "the old sessions give up their last half minute",
    )
    assert desk.current.session is not None
    # The camera delivers frames and reports its state.
    assert desk.current.session.source.read() is not None
    assert desk.current.state().live is not None


def test_a_refused_opening_leaves_the_old_session_unchanged(desk: Desk, cameras: Cameras) -> None:
    desk.ask(CALIBRATING)
    before = desk.current.session
    assert before is not None
    reply = desk.ask(observed(text=calibration(128)))
    assert reply is not None
    assert "128x48" in str(reply.error)
    assert desk.current.session is before
    assert not before.resting
    assert before.source.read() is not None
    assert cameras.opened == [SPEC]


def test_the_old_session_rests_while_its_cameras_are_handed_over(desk: Desk) -> None:
    desk.ask(observed())
    session = desk.current.session
    assert session is not None
    command = observed()
    desk.current.begin(Request(9, command), command)
    # Two readers would take each other's frames.
    assert session.resting
    assert desk.current.state().state is EngineState.PREVIEW
    desk.finished()
    assert desk.current.session is not session


def test_renamed_cameras_are_closed_first_and_reopened_on_refusal(
    desk: Desk, cameras: Cameras
) -> None:
    desk.ask(CALIBRATING)
    assert desk.ask(BeginCalibration(SWAPPED, Board())) is not None
    assert cameras.opened == [SPEC, SWAPPED]
    reply = desk.ask(observed(SPEC, calibration(128)))
    assert reply is not None
    assert reply.error is not None
    # The calibration goes on once its cameras are open again.
    again = desk.finished()
    assert again is not None
    assert again.error is None
    assert cameras.opened == [SPEC, SWAPPED, SPEC, SWAPPED]
    assert desk.current.state().state is EngineState.CALIBRATING


def test_disconnected_cameras_are_reported(desk: Desk, cameras: Cameras) -> None:
    desk.ask(observed())
    cameras.gone = True
    reply = desk.ask(observed(SWAPPED))
    assert reply is not None
    assert "is gone" in str(reply.error)
    desk.finished()
    assert desk.current.state().state is EngineState.FAILED
    assert "is gone" in str(desk.current.state().reason)


@pytest.mark.parametrize("given_up", [True, False])
def test_closing_leaves_nothing_open(desk: Desk, cameras: Cameras, given_up: bool) -> None:
    desk.ask(observed())
    command = observed()
    desk.current.begin(Request(9, command), command)
    if given_up:
        assert desk.current.give_up_opening("it was closed") is not None
        desk.current.close()
        assert desk.finished() is None
    else:
        desk.finished()
        desk.current.close()
    assert cameras.open == 0
    assert desk.current.state().state is EngineState.IDLE


def test_a_cancelled_handover_leaves_no_source_to_the_live_truth(
    desk: Desk, cameras: Cameras
) -> None:
    desk.ask(observed())
    assert desk.truth.source is not None
    command = replace(observed(), opening=2)
    desk.current.begin(Request(9, command), command)
    assert desk.current.cancel(2, "it took too long") is not None
    assert desk.truth.source is None
    assert desk.current.state().state is EngineState.FAILED
    assert desk.current.state().reason == (
        "opening camera:0,1 was cancelled because it took too long"
    )
    assert desk.finished() is None
    assert cameras.open == 0


def test_switching_to_another_source_closes_the_cameras(desk: Desk, cameras: Cameras) -> None:
    desk.ask(observed())
    desk.ask(observed("numbers"))
    assert cameras.open == 0
    desk.ask(observed())
    assert cameras.opened == [SPEC, SPEC]
