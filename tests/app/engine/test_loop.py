"""The engine's loop in this process: a source of numbers, an observer that counts."""

from __future__ import annotations

import dataclasses
import itertools
import queue
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.engine.loop import Engine
from app.messages import (
    CloseSource,
    Command,
    EngineState,
    ExplainPixel,
    HeartbeatEvent,
    ObservationEvent,
    OpenSource,
    PreviewCalibration,
    RecordOrder,
    RecordRobots,
    Reply,
    Request,
    SaveRing,
    SetParameters,
    SetPlayback,
    Shutdown,
    SkippedFrameEvent,
    StateEvent,
    StopRun,
    WatchViews,
)
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import SourceError
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.recording.reader import Recording
from observer.truth.contract import TrueBody
from observer.types import NoTrace, Observation, Status, StereoFrame, Trace

PATIENCE_S = 20.0
Numbered = Callable[..., Any]


class CountingObserver:
    """Finds nothing; remembers with which parameters each frame was observed."""

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
    """One obstacle that moves along x with its source time."""

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
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
        self.closed = False

    def watch(self, names: tuple[str, ...]) -> None:
        self.watched = names

    def publish(self, _: Any) -> None:
        self.published += 1

    def show_cameras(self, facts: dict[str, Any], draw: Callable[[str], Any]) -> None:
        self.shown = [facts, draw("camera_left"), draw("camera_right")]

    def forget(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


class Bench:
    """An engine in a thread, its messages in a list, and its sources by name."""

    def __init__(self) -> None:
        self.sources: dict[str, Any] = {}
        self.open_gate: threading.Event | None = None
        self.truth: StandingTruth | None = None
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
            open_source=self._open,
            make_observer=self._make_observer,
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
        return OpenedSource(self.sources[spec], self.truth)

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

    def ask(self, command: Command) -> int:
        self._number += 1
        self.inbox.put(Request(self._number, command))
        return self._number

    def answer(self, command: Command) -> Reply:
        number = self.ask(command)
        return self.wait(Reply, lambda reply: reply.number == number)

    def value(self, command: Command) -> dict[str, Any]:
        reply = self.answer(command)
        assert reply.refusal is None, reply.error
        assert reply.value is not None
        return reply.value

    def wait(self, kind: type, fits: Callable[[Any], bool] = lambda _: True) -> Any:
        """The first message of this kind that fits, past ones included."""

        def found() -> Any:
            return next((m for m in self.messages if isinstance(m, kind) and fits(m)), None)

        with self._arrived:
            assert self._arrived.wait_for(lambda: found() is not None, PATIENCE_S), (
                f"no such {kind.__name__} among {self.messages[-20:]}"
            )
            return found()

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


@pytest.fixture
def bench(numbered: Numbered) -> Iterator[Bench]:
    made = Bench()
    made.sources["numbers"] = numbered(5)
    made.sources["many"] = numbered(10_000)
    with made:
        yield made


def opening(source: str = "numbers", **changes: Any) -> OpenSource:
    command = OpenSource(source, None, {}, parameters_revision=1, loop=False, rate=4.0)
    return dataclasses.replace(command, **changes)


def test_it_begins_idle_and_beats(bench: Bench) -> None:
    bench.wait(StateEvent, lambda s: s.state is EngineState.IDLE)
    time.sleep(1.0)
    beats = [beat.monotonic for beat in bench.all(HeartbeatEvent)]
    # 20/s are meant and 10/s promised; this machine may be busy.
    assert len(beats) >= 10


def test_a_source_is_observed_to_its_end(bench: Bench) -> None:
    value = bench.value(opening())
    assert value["state"] == "preview"
    assert value["camera"]["width"] == 64
    assert value["source"]["kind"] == "numbers"
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback["ended"])
    events = bench.all(ObservationEvent)
    assert [e.line["frame"] for e in events] == [0, 1, 2, 3, 4]
    assert [e.sequence for e in events] == [0, 1, 2, 3, 4]
    assert all(e.published >= e.received > 0 for e in events)
    assert bench.state.state is EngineState.PREVIEW
    assert bench.state.playback is not None
    assert bench.state.playback["frame"] == 4
    assert bench.publisher.published == 5
    assert bench.answer(StopRun()).refusal == "state"


def test_a_pixel_of_the_newest_frame_can_be_asked(bench: Bench) -> None:
    refused = bench.answer(ExplainPixel(3.0, 4.0))
    assert refused.refusal == "state"
    assert "no frame" in (refused.error or "")
    bench.value(opening(segment=2))
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback["ended"])
    value = bench.value(ExplainPixel(3.0, 4.5))
    assert (value["frame"], value["segment"]) == (4, 2)
    assert (value["u"], value["v"]) == (3.0, 4.5)
    # The observer of these tests compares no frames.
    assert value["verdict"] == "undecided"
    outside = bench.answer(ExplainPixel(64.0, 0.0))
    assert outside.refusal == "input"
    assert "64 x 48" in (outside.error or "")
    bench.value(CloseSource())
    assert bench.answer(ExplainPixel(3.0, 4.0)).refusal == "state"


def test_a_run_is_marked_until_it_is_stopped(bench: Bench) -> None:
    bench.value(opening("many", run_id="r1", segment=3))
    event = bench.wait(ObservationEvent)
    assert (event.run_id, event.line["segment"]) == ("r1", 3)
    assert (bench.state.state, bench.state.run_id) == (EngineState.RUNNING, "r1")
    refused = bench.answer(opening())
    assert refused.refusal == "state"
    assert "run" in (refused.error or "")
    bench.value(StopRun())
    assert bench.state.state is EngineState.PREVIEW
    bench.wait(ObservationEvent, lambda e: e.run_id is None)


def test_a_looped_source_goes_on_in_segments_with_its_own_truth(bench: Bench) -> None:
    bench.truth = StandingTruth()
    bench.value(opening(loop=True))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 11)
    events = bench.all(ObservationEvent)[:11]
    assert [e.line["segment"] for e in events] == [0] * 5 + [1] * 5 + [2]
    assert [e.truth[0]["position"][0] for e in events] == pytest.approx(
        [100 + (k % 5) / 10 for k in range(11)]
    )
    assert bench.state.has_truth


def test_parameters_act_from_the_frame_that_is_named(bench: Bench) -> None:
    bench.value(opening("many"))
    bench.wait(ObservationEvent, lambda e: e.sequence == 3)
    first = bench.value(SetParameters({"flow.residual_threshold_px": 2.5}, 7))["frame"]
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == first + 2)
    for event in bench.all(ObservationEvent):
        revision = event.line["parameters_revision"]
        assert revision == (7 if event.line["frame"] >= first else 1)
    assert bench.observers[0].parameters.flow.residual_threshold_px == 2.5


def test_refused_parameters_change_nothing(bench: Bench) -> None:
    assert bench.value(SetParameters({}, 2)) == {"frame": None}
    bench.value(opening("many"))
    reply = bench.answer(SetParameters({"flow.residual_threshold_px": -1}, 9))
    assert reply.refusal == "input"
    assert "from 0.1 to 30 px" in (reply.error or "")
    assert bench.observers[0].revision == 1


def test_pause_step_and_restart(bench: Bench) -> None:
    bench.value(opening("many", paused=True))
    time.sleep(0.3)
    assert bench.all(ObservationEvent) == []
    playback = bench.value(SetPlayback(step=2))
    assert playback["paused"] is True
    bench.wait(ObservationEvent, lambda e: e.sequence == 1)
    time.sleep(0.2)
    assert len(bench.all(ObservationEvent)) == 2
    bench.value(SetPlayback(paused=False, rate=2.0))
    bench.wait(ObservationEvent, lambda e: e.sequence == 4)
    bench.value(SetPlayback(restart=True))
    bench.wait(ObservationEvent, lambda e: e.line["segment"] == 1)
    assert bench.answer(SetPlayback(rate=9.0)).refusal == "input"
    assert bench.value(CloseSource()) == {}
    assert bench.answer(SetPlayback(paused=True)).refusal == "state"


def test_the_heart_beats_while_a_source_takes_long_to_open(bench: Bench) -> None:
    bench.open_gate = threading.Event()
    asked = bench.ask(opening())
    time.sleep(0.2)
    bench.forget()
    time.sleep(1.0)
    assert len(bench.all(HeartbeatEvent)) >= 10
    assert bench.answer(opening("many")).refusal == "state"
    bench.value(SetParameters({"flow.residual_threshold_px": 3.0}, 5))
    bench.open_gate.set()
    bench.wait(Reply, lambda r: r.number == asked and r.refusal is None)
    event = bench.wait(ObservationEvent)
    assert event.line["parameters_revision"] == 5, "set while opening, so it must be in force"


def test_an_opening_can_be_given_up(bench: Bench) -> None:
    bench.open_gate = threading.Event()
    asked = bench.ask(opening())
    bench.value(CloseSource())
    assert bench.wait(Reply, lambda r: r.number == asked).refusal == "state"
    bench.open_gate.set()
    bench.value(opening("many"))
    deadline = time.monotonic() + PATIENCE_S
    while bench.sources["numbers"].closed == 0 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert bench.sources["numbers"].closed == 1
    assert bench.state.source is not None
    assert bench.state.source["frame_count"] == 10_000


def test_the_heart_beats_between_slow_stages(bench: Bench) -> None:
    bench.value(opening("many", paused=True))
    bench.observers[0].slow_stages = [0.1] * 15
    bench.forget()
    bench.ask(SetPlayback(step=1))
    bench.wait(ObservationEvent)
    beats = [beat.monotonic for beat in bench.all(HeartbeatEvent)]
    assert len(beats) >= 12
    assert max(b - a for a, b in itertools.pairwise(beats)) < 1.0


def test_what_cannot_be_opened_is_refused_and_said(bench: Bench, numbered: Numbered) -> None:
    reply = bench.answer(opening("nothing"))
    assert reply.refusal == "input"
    assert reply.error == "there is no nothing; give a name that exists"
    assert (bench.state.state, bench.state.reason) == (EngineState.FAILED, reply.error)
    bench.value(opening("many"))
    assert bench.state.state is EngineState.PREVIEW
    # While something is open, a refusal leaves it as it is.
    bench.sources["broken"] = OSError("the disk is on fire")
    reply = bench.answer(opening("broken"))
    assert reply.refusal == "failure"
    assert "the disk is on fire" in (reply.error or "")
    bench.sources["empty"] = numbered(3, broken={0, 1, 2})
    assert "no frame that can be read" in (bench.answer(opening("empty")).error or "")
    assert bench.sources["empty"].closed == 1
    assert bench.state.state is EngineState.PREVIEW


def test_a_missing_or_unfit_calibration_is_one_sentence(bench: Bench, numbered: Numbered) -> None:
    bench.sources["bare"] = numbered(5, own_calibration=None, spec="bare")
    reply = bench.answer(opening("bare"))
    assert reply.refusal == "input"
    assert "bare brings no calibration" in (reply.error or "")
    assert "choose a calibration" in (reply.error or "")
    # With the images it was asked for, a calibration can be tried out all the same.
    fitting = calibration_text(numbered().own_calibration)
    assert bench.value(PreviewCalibration(fitting))["jpeg"].startswith(b"\xff\xd8")
    unfit = calibration_text(StereoCalibration.rectified(80, 60, 60, 60, 40, 30, 0.1))
    reply = bench.answer(opening("bare", calibration_yaml=unfit))
    assert "80x60" in (reply.error or "")
    assert "64x48" in (reply.error or "")
    reply = bench.answer(opening("bare", calibration_yaml="not: a calibration"))
    assert reply.refusal == "input"
    bench.value(opening("bare", calibration_yaml=fitting))


def test_a_calibration_cannot_be_tried_without_an_image(bench: Bench, numbered: Numbered) -> None:
    text = calibration_text(numbered().own_calibration)
    assert bench.answer(PreviewCalibration(text)).refusal == "state"
    bench.value(opening("many", paused=True))
    assert bench.value(PreviewCalibration(text))["matches"] == 0
    assert bench.answer(PreviewCalibration("nonsense")).refusal == "input"


def test_a_stage_that_breaks_fails_the_session_not_the_engine(bench: Bench) -> None:
    bench.value(opening("many", paused=True, run_id="r2"))
    bench.observers[0].breaks_at = 1
    bench.value(SetPlayback(step=3))
    failed = bench.wait(StateEvent, lambda s: s.state is EngineState.FAILED)
    assert "ZeroDivisionError: a stage broke" in failed.reason
    assert failed.run_id == "r2"
    assert failed.source["frame_count"] == 10_000
    assert bench.sources["many"].closed == 1
    bench.value(opening())
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback["ended"])


def test_a_read_that_breaks_fails_the_session_not_the_engine(
    bench: Bench, numbered: Numbered
) -> None:
    source = bench.sources["fragile"] = numbered(10_000)
    bench.value(opening("fragile", paused=True))

    def unplugged() -> None:
        raise SourceError("the camera is gone; plug it in again")

    source.read = unplugged
    bench.value(SetPlayback(step=1))
    failed = bench.wait(StateEvent, lambda s: s.state is EngineState.FAILED)
    assert failed.reason == "reading numbered failed: the camera is gone; plug it in again"
    bench.value(CloseSource())
    bench.wait(StateEvent, lambda s: s.state is EngineState.IDLE)
    assert bench.state.state is EngineState.IDLE


def test_unreadable_frames_are_reported(bench: Bench, numbered: Numbered) -> None:
    bench.sources["holes"] = numbered(6, broken={0, 3})
    bench.value(opening("holes"))
    last = bench.wait(ObservationEvent, lambda e: e.line["frame"] == 5)
    assert last.frame_skips == 2
    assert bench.all(SkippedFrameEvent) == [
        SkippedFrameEvent(0, "frame 0 is damaged"),
        SkippedFrameEvent(3, "frame 3 is damaged"),
    ]


def test_watching_reaches_the_publisher_and_shutdown_ends(bench: Bench) -> None:
    bench.value(WatchViews(("left", "cloud")))
    assert bench.publisher.watched == ("left", "cloud")
    bench.value(opening("many"))
    bench.value(Shutdown())
    bench._thread.join(PATIENCE_S)
    assert not bench._thread.is_alive()
    assert bench.sources["many"].closed == 1
    assert bench.publisher.closed


def test_a_run_is_recorded_as_it_was_observed(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "r1" / "recording.mcap"
    bench.truth = StandingTruth()
    bench.sources["numbers"].broken = (3,)
    bench.value(
        opening(run_id="r1", record=RecordOrder(str(path), "lossless", "a run"), paused=True)
    )
    assert bench.state.recording is not None
    assert bench.state.recording["images"] == "lossless"
    bench.value(SetParameters({"ego_motion.ransac_threshold_px": 3.0}, revision=2))
    bench.value(RecordRobots(({"role": "observer", "received": 1.0, "sent_speed": 0.3},)))
    bench.value(SetPlayback(paused=False))
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback["ended"])
    stopped = bench.value(StopRun())
    assert stopped["recording"]["bytes"] == path.stat().st_size
    assert bench.state.state is EngineState.PREVIEW
    assert bench.state.recording is None
    events = bench.all(ObservationEvent)
    with Recording(path) as recording:
        assert not recording.unfinished
        assert list(recording.lines()) == [event.line for event in events]
        assert [f.index for f in recording.frames] == [0, 1, 2, 4]
        assert [f.received for f in recording.frames] == [event.received for event in events]
        assert [pixels.max() for pixels in (recording.pair(k)[0] for k in range(4))] == [0, 1, 2, 4]
        assert [(at, r.revision) for at, r in recording.positioned_revisions] == [(0, 1), (0, 2)]
        assert recording.positioned_revisions[1][1].difference == {
            "ego_motion.ransac_threshold_px": 3.0
        }
        assert [s.index for s in recording.skipped()] == [3]
        assert [row.sent_speed for row in recording.robot_rows()] == [0.3]
        matched = [[b.track_id for b in each.bodies] for each in recording.matched_truth()]
        assert matched == [[None]] * 4
        truth = recording.truth()
        assert truth is not None
        # The truth's own world and the frame's time.
        assert truth.bodies(100.0)[0].position.tolist() == [100.0, 0.0, 5.0]


def test_a_frame_that_breaks_the_observer_is_recorded_with_why(
    bench: Bench, tmp_path: Path
) -> None:
    path = tmp_path / "recording.mcap"
    record = RecordOrder(str(path), "none", "a run")
    bench.value(opening("many", run_id="r1", record=record, paused=True))
    bench.observers[-1].breaks_at = 2
    bench.value(SetPlayback(paused=False))
    bench.wait(StateEvent, lambda s: s.state is EngineState.FAILED)
    bench.ask(Shutdown())
    bench._thread.join(PATIENCE_S)
    with Recording(path) as recording:
        assert not recording.unfinished
        assert [f.index for f in recording.frames] == [0, 1, 2]
        assert ["a stage broke" in i.sentence for i in recording.incidents()] == [True]


def test_a_recording_without_room_refuses_the_run(bench: Bench, tmp_path: Path) -> None:
    order = RecordOrder(str(tmp_path / "r.mcap"), "jpeg", "a run", reserve_bytes=1 << 60)
    refused = bench.answer(opening(run_id="r1", record=order))
    assert refused.refusal == "full"
    assert bench.sources["numbers"].closed == 1


def test_the_last_half_minute_of_a_live_source_can_be_had(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    bench.sources["camera"] = numbered(8, live=True)
    assert bench.answer(SaveRing(str(tmp_path / "none.mcap"))).refusal == "state"
    bench.value(opening("numbers"))
    assert "live cameras" in str(bench.answer(SaveRing(str(tmp_path / "none.mcap"))).error)
    bench.value(opening("camera"))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 7)
    assert bench.state.recording is None
    path = tmp_path / "rings" / "ring.mcap"
    saved = bench.value(SaveRing(str(path)))
    assert saved["bytes"] == path.stat().st_size
    with Recording(path) as recording:
        assert not recording.unfinished
        assert [f.index for f in recording.frames] == list(range(8))
        assert recording.frames[0].begins == "observer"
        assert len(list(recording.lines())) == 8
        assert recording.pair(7)[0].shape == (48, 64)
    full = SaveRing(str(tmp_path / "full.mcap"), reserve_bytes=1 << 60)
    assert bench.answer(full).refusal == "full"


def test_behind_a_run_the_last_half_minute_of_a_live_source_is_kept_again(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    bench.sources["camera"] = numbered(100_000, live=True)
    record = RecordOrder(str(tmp_path / "run.mcap"), "none", "a run")
    bench.value(opening("camera", run_id="r1", record=record))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 3)
    bench.value(SaveRing(str(tmp_path / "within.mcap")))
    bench.value(StopRun())
    bench.wait(ObservationEvent, lambda e: e.run_id is None)
    path = tmp_path / "behind.mcap"
    bench.value(SaveRing(str(path)))
    with Recording(path) as recording:
        assert recording.facts.id == ""
        assert recording.frames
        assert len(recording.parameter_revisions()) == 1
    with Recording(tmp_path / "within.mcap") as recording:
        assert recording.facts.id == "r1"
    # The run's own recording is whole, and is not gone on with.
    with Recording(tmp_path / "run.mcap") as recording:
        assert not recording.unfinished
