"""The engine's loop in the test's own process: a numbered source, an observer that counts."""

from __future__ import annotations

import dataclasses
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from app.contract.commands import OpenSource, ToEngine
from app.contract.events import StateEvent
from app.engine.drive_link import DriveLink
from app.engine.loop import Engine
from app.engine.preparing import Preparing
from app.runtime.requests import Reply, Request
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import SourceError
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.trace import NoTrace, Trace
from observer.truth.contract import TrueBody
from observer.types import Observation, Status, StereoFrame

PATIENCE_S = 20.0
Numbered = Callable[..., Any]


class CountingObserver:
    """Finds nothing; remembers the parameters with which each frame was observed."""

    def __init__(
        self,
        calibration: StereoCalibration,
        parameters: Parameters,
        *,
        parameters_revision: int,
        mount: CameraMount | None,  # noqa: ARG002
        clock: Callable[[], float],
    ) -> None:
        self.camera = StereoCamera(
            calibration.width, calibration.height, 60.0, 60.0, 32.0, 24.0, calibration.baseline
        )
        self.parameters = parameters
        self.revision = parameters_revision
        self.segment = 0
        self.clock = clock
        self.slow_stages: list[float] = []
        self.breaks_at: int | None = None

    def use(self, parameters: Parameters, revision: int) -> None:
        self.parameters, self.revision = parameters, revision

    def begin_segment(self) -> None:
        self.segment += 1

    def observe(self, frame: StereoFrame, trace: Trace | None = None) -> Observation:
        trace = NoTrace() if trace is None else trace
        if frame.index == self.breaks_at:
            raise ZeroDivisionError("a stage broke")
        for seconds in self.slow_stages:
            time.sleep(seconds)
            self.clock()
        trace.keep("left", frame.left)
        return Observation(
            frame.index,
            frame.time,
            frame.received,
            self.segment,
            Status.OK,
            (),
            self.revision,
            Pose.identity(),
            (),
        )


class StandingTruth:
    """One obstacle that moves along x with its source time; remembers the times asked for."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        self.asked.append(time)
        position, velocity = np.array([time, 0.0, 5.0]), np.array([1.0, 0.0, 0.0])
        size = np.array([0.4, 0.4, 0.4])
        return (TrueBody(1, "box", "obstacle", position, velocity, size, 0.0, 1.0, None),)

    def camera_pose(self, time: float) -> Pose | None:
        del time
        return Pose.identity()


class Publisher:
    """Remembers what it was told to watch and to publish."""

    def __init__(self) -> None:
        self.watched: tuple[str, ...] = ()
        self.published = 0
        self.newest: Any = None
        self.troubles: tuple[str, ...] = ()
        self.closed = False

    def watch(self, names: tuple[str, ...]) -> None:
        self.watched = names

    def publish(self, observed: Any, keep: Any = None) -> None:
        del keep
        self.newest = observed
        self.published += 1

    def show_cameras(self, frame: StereoFrame, draw: Callable[[str], Any]) -> None:
        self.shown = [frame, draw("camera_left"), draw("camera_right")]

    def forget(self) -> None:
        self.newest = None

    def close(self) -> None:
        self.closed = True


class Bench:
    """An engine in a thread, its messages in a list, and its sources by name."""

    def __init__(self, drive: DriveLink | None = None, preparing: Preparing | None = None) -> None:
        self._drive = drive
        self._preparing = preparing
        self.sources: dict[str, Any] = {}
        self.open_gate: threading.Event | None = None
        self.truth: StandingTruth | None = None
        self.calibration_notes: tuple[str, ...] = ()
        self.observers: list[CountingObserver] = []
        self.publisher = Publisher()
        self.inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.messages: list[Any] = []
        self._arrived = threading.Condition()
        self._number = 0
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        Engine(
            inbox=self.inbox,
            send=self._take,
            observations_lost=lambda: 0,
            publisher=self.publisher,  # type: ignore[arg-type]
            drive=self._drive,
            open_source=self._open,
            make_observer=self._make_observer,
            preparing=self._preparing,
        ).run()

    def _take(self, message: object) -> None:
        with self._arrived:
            self.messages.append(message)
            self._arrived.notify_all()

    def _open(self, spec: str) -> OpenedSource:
        if self.open_gate is not None:
            assert self.open_gate.wait(PATIENCE_S)
        if spec not in self.sources:
            raise SourceError(f"there is no {spec}; give a name that exists")
        if isinstance(self.sources[spec], Exception):
            raise self.sources[spec]
        return OpenedSource(
            self.sources[spec], self.truth, calibration_notes=self.calibration_notes
        )

    def _make_observer(self, *args: Any, **more: Any) -> CountingObserver:
        self.observers.append(CountingObserver(*args, **more))
        return self.observers[-1]

    def __enter__(self) -> Bench:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.inbox.put(None)
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def ask(self, command: ToEngine[Any]) -> int:
        self._number += 1
        self.inbox.put(Request(self._number, command))
        return self._number

    def answer(self, command: ToEngine[Any]) -> Reply:
        number = self.ask(command)
        return self.wait(Reply, lambda reply: reply.number == number)

    def value(self, command: ToEngine[Any]) -> Any:
        reply = self.answer(command)
        assert reply.refusal is None, reply.error
        return reply.value

    def wait(self, kind: type, fits: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the first message of this kind that fits, past ones included."""

        # Each message is looked at once: a source that nothing paces sends thousands a second.
        looked = 0
        end = time.monotonic() + PATIENCE_S
        with self._arrived:
            while True:
                for message in self.messages[looked:]:
                    if isinstance(message, kind) and fits(message):
                        return message
                looked = len(self.messages)
                assert self._arrived.wait(end - time.monotonic()), (
                    f"no such {kind.__name__} among {self.messages[-20:]}"
                )

    def all(self, kind: type) -> list[Any]:
        with self._arrived:
            return [m for m in self.messages if isinstance(m, kind)]

    def forget(self) -> None:
        with self._arrived:
            self.messages.clear()

    @property
    def state(self) -> StateEvent:
        state: StateEvent = self.all(StateEvent)[-1]
        return state


def opening(source: str = "numbers", **changes: Any) -> OpenSource:
    command = OpenSource(source, None, {}, parameters_revision=1, loop=False, rate=4.0)
    return dataclasses.replace(command, **changes)
