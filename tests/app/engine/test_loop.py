"""The engine's loop: opening, observing, commands, heartbeats, failures."""

from __future__ import annotations

import itertools
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.contract.commands import (
    CancelOpening,
    CloseSource,
    ExplainPixel,
    PreviewCalibration,
    RecordOrder,
    SetParameters,
    SetPlayback,
    Shutdown,
    StopRun,
    WatchViews,
)
from app.contract.events import (
    EngineState,
    HeartbeatEvent,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
)
from app.engine.observed import Observed
from app.runtime.requests import Reply
from observer.calibration.ageing.watch import AgeingWatch
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import SourceError

from ...waiting import until
from .bench import PATIENCE_S, Bench, Numbered, StandingTruth, opening


def test_it_starts_idle_and_sends_heartbeats(bench: Bench) -> None:
    bench.wait(StateEvent, lambda s: s.state is EngineState.IDLE)
    time.sleep(1.0)
    beats = [beat.monotonic for beat in bench.all(HeartbeatEvent)]
    # The engine sends 20/s and promises 10/s; this machine may be busy.
    assert len(beats) >= 10


def test_a_source_is_observed_until_its_end(bench: Bench) -> None:
    value = bench.value(opening())
    assert value.state.state == "preview"
    assert value.state.camera.width == 64
    assert value.state.source.kind == "numbers"
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
    events = bench.all(ObservationEvent)
    assert [e.line["frame"] for e in events] == [0, 1, 2, 3, 4]
    assert [e.sequence for e in events] == [0, 1, 2, 3, 4]
    assert all(e.published >= e.received > 0 for e in events)
    assert bench.state.state is EngineState.PREVIEW
    assert bench.state.playback is not None
    assert bench.state.playback.frame == 4
    assert bench.publisher.published == 5
    assert bench.answer(StopRun()).refusal == "state"


def test_a_pixel_of_the_newest_frame_is_explained(bench: Bench) -> None:
    refused = bench.answer(ExplainPixel(3.0, 4.0))
    assert refused.refusal == "state"
    assert "no frame" in (refused.error or "")
    bench.value(opening(segment=2))
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
    value = bench.value(ExplainPixel(3.0, 4.5))
    assert (value.frame, value.segment) == (4, 2)
    assert (value.u, value.v) == (3.0, 4.5)
    # The observer of these tests compares no frames.
    assert value.verdict == "undecided"
    outside = bench.answer(ExplainPixel(64.0, 0.0))
    assert outside.refusal == "input"
    assert "64 x 48" in (outside.error or "")
    bench.value(CloseSource())
    assert bench.answer(ExplainPixel(3.0, 4.0)).refusal == "state"


def test_observations_carry_the_run_id_until_it_is_stopped(bench: Bench) -> None:
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


def test_a_looped_source_continues_in_new_segments_with_its_truth(bench: Bench) -> None:
    bench.truth = StandingTruth()
    bench.value(opening(loop=True))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 11)
    events = bench.all(ObservationEvent)[:11]
    assert [e.line["segment"] for e in events] == [0] * 5 + [1] * 5 + [2]
    assert [e.truth[0]["position"][0] for e in events] == pytest.approx(
        [100 + (k % 5) / 10 for k in range(11)]
    )
    assert bench.state.has_truth


def test_parameters_apply_from_the_returned_frame(bench: Bench) -> None:
    bench.value(opening("many"))
    bench.wait(ObservationEvent, lambda e: e.sequence == 3)
    first = bench.value(SetParameters({"flow.residual_threshold_px": 2.5}, 7))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == first + 2)
    for event in bench.all(ObservationEvent):
        revision = event.line["parameters_revision"]
        assert revision == (7 if event.line["frame"] >= first else 1)
    assert bench.observers[0].parameters.flow.residual_threshold_px == 2.5


@pytest.mark.parametrize("change", [{"guard.step_m": 0.2}, {"navigation.berth_m": 0.3}])
def test_parameters_of_driving_never_reach_the_observer(
    bench: Bench, change: dict[str, float]
) -> None:
    bench.value(opening("many"))
    observer = bench.observers[0]
    before = observer.parameters
    frame = bench.value(SetParameters(change, revision=1))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] >= frame)
    assert observer.parameters is before
    assert not hasattr(before, "guard")
    assert not hasattr(before, "navigation")


def test_refused_parameters_change_nothing(bench: Bench) -> None:
    assert bench.value(SetParameters({}, 2)) is None
    bench.value(opening("many"))
    reply = bench.answer(SetParameters({"flow.residual_threshold_px": -1}, 9))
    assert reply.refusal == "input"
    assert "from 0.1 to 30 px" in (reply.error or "")
    assert bench.observers[0].revision == 1


def test_playback_can_be_paused_stepped_and_restarted(bench: Bench) -> None:
    bench.value(opening("many", paused=True))
    time.sleep(0.3)
    assert bench.all(ObservationEvent) == []
    playback = bench.value(SetPlayback(step=2))
    assert playback.paused is True
    bench.wait(ObservationEvent, lambda e: e.sequence == 1)
    time.sleep(0.2)
    assert len(bench.all(ObservationEvent)) == 2
    bench.value(SetPlayback(paused=False, rate=2.0))
    bench.wait(ObservationEvent, lambda e: e.sequence == 4)
    bench.value(SetPlayback(restart=True))
    bench.wait(ObservationEvent, lambda e: e.line["segment"] == 1)
    assert bench.answer(SetPlayback(rate=9.0)).refusal == "input"
    assert bench.value(CloseSource()) is None
    assert bench.answer(SetPlayback(paused=True)).refusal == "state"


def test_heartbeats_continue_while_a_source_is_slow_to_open(bench: Bench) -> None:
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


def test_an_opening_can_be_cancelled(bench: Bench) -> None:
    bench.open_gate = threading.Event()
    asked = bench.ask(opening())
    bench.value(CloseSource())
    assert bench.wait(Reply, lambda r: r.number == asked).refusal == "state"
    bench.open_gate.set()
    bench.value(opening("many"))
    until(lambda: bench.sources["numbers"].closed)
    assert bench.sources["numbers"].closed == 1
    assert bench.state.source is not None
    assert bench.state.source.frame_count == 10_000


def test_a_cancelled_opening_neither_records_nor_holds_its_source(
    bench: Bench, tmp_path: Path
) -> None:
    bench.open_gate = threading.Event()
    record = RecordOrder(str(tmp_path / "r1" / "recording.mcap"), "lossless", "a run")
    asked = bench.ask(opening(run_id="r1", record=record, opening=1))
    bench.value(CancelOpening(1, "it took too long"))
    refused = bench.wait(Reply, lambda r: r.number == asked)
    assert refused.refusal == "state"
    assert refused.error == "opening numbers was cancelled because it took too long"
    assert (bench.state.state, bench.state.reason) == (EngineState.FAILED, refused.error)
    slow, bench.open_gate = bench.open_gate, None
    bench.value(opening("many", opening=2))
    # It is over already; the newer one goes on.
    bench.value(CancelOpening(1, "it took too long"))
    slow.set()
    until(lambda: bench.sources["numbers"].closed)
    assert bench.sources["numbers"].closed == 1
    assert bench.state.state is EngineState.PREVIEW
    assert bench.state.source is not None
    assert bench.state.source.frame_count == 10_000
    assert not any(tmp_path.iterdir())


def test_an_opening_is_cancelled_even_if_it_has_just_succeeded(bench: Bench) -> None:
    bench.value(opening("many", run_id="r1", opening=1))
    bench.value(CancelOpening(1, "it took too long"))
    assert bench.state.state is EngineState.FAILED
    assert bench.sources["many"].closed == 1
    bench.value(opening())


def test_heartbeats_continue_between_slow_stages(bench: Bench) -> None:
    bench.value(opening("many", paused=True))
    bench.observers[0].slow_stages = [0.1] * 15
    bench.forget()
    bench.ask(SetPlayback(step=1))
    bench.wait(ObservationEvent)
    beats = [beat.monotonic for beat in bench.all(HeartbeatEvent)]
    assert len(beats) >= 12
    assert max(b - a for a, b in itertools.pairwise(beats)) < 1.0


def test_a_source_that_cannot_be_opened_is_refused_with_a_reason(
    bench: Bench, numbered: Numbered
) -> None:
    reply = bench.answer(opening("nothing"))
    assert reply.refusal == "input"
    assert reply.error == "there is no nothing; give a name that exists"
    assert (bench.state.state, bench.state.reason) == (EngineState.FAILED, reply.error)
    bench.value(opening("many"))
    assert bench.state.state is EngineState.PREVIEW
    # While something is open, a refused opening leaves it as it is.
    bench.sources["broken"] = OSError("the disk is on fire")
    reply = bench.answer(opening("broken"))
    assert reply.refusal == "failure"
    assert "the disk is on fire" in (reply.error or "")
    bench.sources["empty"] = numbered(3, broken={0, 1, 2})
    assert "contains no readable frame" in (bench.answer(opening("empty")).error or "")
    assert bench.sources["empty"].closed == 1
    assert bench.state.state is EngineState.PREVIEW


def test_a_missing_or_unsuitable_calibration_is_refused_with_a_reason(
    bench: Bench, numbered: Numbered
) -> None:
    bench.sources["bare"] = numbered(5, own_calibration=None, spec="bare")
    reply = bench.answer(opening("bare"))
    assert reply.refusal == "input"
    assert "bare has no calibration" in (reply.error or "")
    assert "choose a calibration" in (reply.error or "")
    # A calibration can still be tried on the images of the source that was refused.
    fitting = calibration_text(numbered().own_calibration)
    assert bench.value(PreviewCalibration(fitting)).jpeg.startswith(b"\xff\xd8")
    unfit = calibration_text(StereoCalibration.rectified(80, 60, 60, 60, 40, 30, 0.1))
    reply = bench.answer(opening("bare", calibration_yaml=unfit))
    assert "80x60" in (reply.error or "")
    assert "64x48" in (reply.error or "")
    reply = bench.answer(opening("bare", calibration_yaml="not: a calibration"))
    assert reply.refusal == "input"
    bench.value(opening("bare", calibration_yaml=fitting))


def test_notes_on_the_sources_calibration_are_reported_while_it_is_used(
    bench: Bench, numbered: Numbered, caplog: pytest.LogCaptureFixture
) -> None:
    bench.calibration_notes = ("calibration.yaml: D1 was replaced",)
    bench.sources["noted"] = numbered(5, spec="noted")
    bench.value(opening("noted"))
    told = "calibration of noted: calibration.yaml: D1 was replaced"
    assert bench.state.calibration_notes == (told,)
    assert told in caplog.messages
    caplog.clear()
    bench.sources["noted"] = numbered(5, spec="noted")
    text = calibration_text(numbered().own_calibration)
    bench.value(opening("noted", calibration_yaml=text))
    assert bench.state.calibration_notes == ()
    assert told not in caplog.messages


def test_a_calibration_preview_is_refused_without_an_image(
    bench: Bench, numbered: Numbered
) -> None:
    text = calibration_text(numbered().own_calibration)
    assert bench.answer(PreviewCalibration(text)).refusal == "state"
    bench.value(opening("many", paused=True))
    assert bench.value(PreviewCalibration(text)).matches == 0
    assert bench.answer(PreviewCalibration("nonsense")).refusal == "input"


def test_a_failing_stage_fails_the_session_not_the_engine(bench: Bench) -> None:
    bench.value(opening("many", paused=True, run_id="r2"))
    bench.observers[0].breaks_at = 1
    bench.value(SetPlayback(step=3))
    failed = bench.wait(StateEvent, lambda s: s.state is EngineState.FAILED)
    assert "ZeroDivisionError: a stage broke" in failed.reason
    assert failed.run_id == "r2"
    assert failed.source.frame_count == 10_000
    assert bench.sources["many"].closed == 1
    bench.value(opening())
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)


def test_what_only_people_look_at_may_fail(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def failing(*_: object) -> None:
        raise ZeroDivisionError("no rows")

    monkeypatch.setattr(AgeingWatch, "add_frame", failing)
    bench.value(opening())
    bench.publisher.troubles = ("drawing the view left failed",)
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
    assert bench.publisher.published == 5
    assert bench.state.state is EngineState.PREVIEW
    bench.wait(StateEvent, lambda s: len(s.troubles) == 2)
    unchecked, undrawn = bench.state.troubles
    assert unchecked.startswith("checking the calibration's age failed: internal error")
    assert undrawn == "drawing the view left failed"
    assert caplog.messages == ["checking the calibration's age failed"]
    bench.publisher.troubles = ()
    bench.value(CloseSource())
    assert bench.state.troubles == ()


def test_the_sight_is_written_before_anything_else_is_published(numbered: Numbered) -> None:
    told: list[tuple[int, int, int]] = []

    def write(seen: Observed, *_: object) -> None:
        sent = len(bench.all(ObservationEvent))
        told.append((seen.frame.index, sent, bench.publisher.published))

    drive: Any = SimpleNamespace(sight=SimpleNamespace(write=write), wheels=None, wayfinder=None)
    with Bench(drive) as bench:
        bench.sources["numbers"] = numbered(3)
        bench.value(opening())
        bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
    assert told == [(0, 0, 0), (1, 1, 1), (2, 2, 2)]


def test_a_failing_read_fails_the_session_not_the_engine(bench: Bench, numbered: Numbered) -> None:
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


def test_watched_views_reach_the_publisher_and_shutdown_ends_the_loop(bench: Bench) -> None:
    bench.value(WatchViews(("left", "cloud")))
    assert bench.publisher.watched == ("left", "cloud")
    bench.value(opening("many"))
    bench.value(Shutdown())
    bench._thread.join(PATIENCE_S)
    assert not bench._thread.is_alive()
    assert bench.sources["many"].closed == 1
    assert bench.publisher.closed
