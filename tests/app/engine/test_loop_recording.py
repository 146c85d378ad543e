"""The engine's loop records what it observes, and keeps the last half minute."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from mcap.reader import make_reader

from app.contract.commands import (
    LiveTruthOrder,
    RecordOrder,
    RecordRobots,
    SaveClip,
    SetParameters,
    SetPlayback,
    Shutdown,
    StopRun,
)
from app.contract.events import EngineState, LocalMapEvent, ObservationEvent, StateEvent
from app.engine.observed import Observed
from observer.navigation.parameters import AllParameters
from observer.occupancy import OccupancyMap
from observer.parameters.reductions import REDUCTIONS
from observer.recording.payloads import RobotRow
from observer.recording.reader import Recording
from observer.sources.contract import LiveReport

from .bench import PATIENCE_S, Bench, Numbered, StandingTruth, opening


def test_a_run_is_recorded_as_it_was_observed(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "r1" / "recording.mcap"
    bench.truth = StandingTruth()
    bench.sources["numbers"].broken = (3,)
    bench.value(
        opening(run_id="r1", record=RecordOrder(str(path), "lossless", "a run"), paused=True)
    )
    assert bench.state.recording is not None
    assert bench.state.recording.images == "lossless"
    threshold = {"ego_motion.ransac_threshold_px": 3.0}
    bench.value(SetParameters(threshold, revision=2))
    bench.value(SetParameters({**threshold, "guard.margin_m": 0.3}, revision=2))
    bench.value(RecordRobots((RobotRow(role="observer", received=1.0, sent_speed=0.3),)))
    bench.value(SetPlayback(paused=False))
    bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
    stopped = bench.value(StopRun())
    assert stopped.bytes == path.stat().st_size
    assert bench.state.state is EngineState.PREVIEW
    assert bench.state.recording is None
    events = bench.all(ObservationEvent)
    with Recording(path) as recording:
        assert not recording.unfinished
        assert list(recording.lines()) == [event.line for event in events]
        assert [f.index for f in recording.frames] == [0, 1, 2, 4]
        assert [f.received for f in recording.frames] == [event.received for event in events]
        assert [pixels.max() for pixels in (recording.pair(k)[0] for k in range(4))] == [0, 1, 2, 4]
        revisions = recording.parameter_revisions()
        assert [(at, r.revision) for at, r in recording.positioned_revisions][:2] == [
            (0, 1),
            (0, 2),
        ]
        assert revisions[1].difference == threshold
        # Changes of the guard are noted as well, but not as a revision of their own.
        assert (revisions[2].revision, revisions[2].difference) == (2, {"guard.margin_m": 0.3})
        assert [s.index for s in recording.skipped()] == [3]
        assert [row.sent_speed for row in recording.robot_rows()] == [0.3]
        matched = [[b.track_id for b in each.bodies] for each in recording.matched_truth()]
        assert matched == [[None]] * 4
        truth = recording.truth()
        assert truth is not None
        # Truth first: a killed engine leaves no observation without it.
        order = [topic for topic, _ in recording.messages("/truth", "/observation")]
        assert order == ["/truth", "/observation"] * 4
        # In the truth's own world frame, at the frame's time.
        assert truth.bodies(100.0)[0].position.tolist() == [100.0, 0.0, 5.0]


class _Mapping:
    """Plans for no frame, and has a local map for every third one."""

    def plan(self, sight: Observed, _: AllParameters) -> OccupancyMap | None:
        frame = sight.frame
        if frame.index % 3:
            return None
        cells = np.full((3, 3), frame.index % 2 + 1, np.uint8)
        return OccupancyMap.of(cells, (0.0, 0.0), 0.1, (0.0, 0.0, 0.0), frame.received)


def test_local_maps_are_sent_and_recorded_with_their_frames(
    numbered: Numbered, tmp_path: Path
) -> None:
    path = tmp_path / "recording.mcap"
    writer = SimpleNamespace(write=lambda observed, *_: observed)
    drive: Any = SimpleNamespace(sight=writer, wheels=None, wayfinder=_Mapping())
    with Bench(drive) as bench:
        bench.sources["mounted"] = numbered(8)
        bench.value(opening("mounted", run_id="r1", record=RecordOrder(str(path), "none", "a run")))
        bench.wait(StateEvent, lambda s: s.playback is not None and s.playback.ended)
        bench.value(StopRun())
        events = bench.all(LocalMapEvent)
    with Recording(path) as recording:
        maps = list(recording.local_maps())
        assert [told.frame for told in maps] == [0, 3, 6]
        frames = {frame.index: frame for frame in recording.frames}
        assert [told.map.received for told in maps] == [frames[k].received for k in (0, 3, 6)]
        assert [set(told.map.cells().ravel().tolist()) for told in maps] == [{1}, {2}, {1}]
    # Without a mount they have no place in the scene.
    assert events == []


def test_a_frame_that_crashes_the_observer_is_recorded_with_the_reason(
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


def test_a_full_disk_refuses_the_run(bench: Bench, tmp_path: Path) -> None:
    order = RecordOrder(str(tmp_path / "r.mcap"), "jpeg", "a run", reserve_bytes=1 << 60)
    refused = bench.answer(opening(run_id="r1", record=order))
    assert refused.refusal == "full"
    assert bench.sources["numbers"].closed == 1


def test_the_last_half_minute_of_a_live_source_can_be_saved(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    bench.sources["camera"] = numbered(8, live=True)
    assert bench.answer(SaveClip(str(tmp_path / "none.mcap"))).refusal == "state"
    bench.value(opening("numbers"))
    assert "live cameras" in str(bench.answer(SaveClip(str(tmp_path / "none.mcap"))).error)
    bench.value(opening("camera"))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 7)
    assert bench.state.recording is None
    path = tmp_path / "clips" / "clip.mcap"
    saved = bench.value(SaveClip(str(path)))
    assert saved.bytes == path.stat().st_size
    with Recording(path) as recording:
        assert not recording.unfinished
        assert [f.index for f in recording.frames] == list(range(8))
        assert recording.frames[0].begins == "observer"
        assert len(list(recording.lines())) == 8
        assert recording.pair(7)[0].shape == (48, 64)
    full = SaveClip(str(tmp_path / "full.mcap"), reserve_bytes=1 << 60)
    assert bench.answer(full).refusal == "full"


def test_after_a_run_the_last_half_minute_is_buffered_again(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    bench.sources["camera"] = numbered(100_000, live=True)
    record = RecordOrder(str(tmp_path / "run.mcap"), "none", "a run")
    bench.value(opening("camera", run_id="r1", record=record))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 3)
    bench.value(SaveClip(str(tmp_path / "within.mcap")))
    bench.value(StopRun())
    bench.wait(ObservationEvent, lambda e: e.run_id is None)
    path = tmp_path / "behind.mcap"
    bench.value(SaveClip(str(path)))
    with Recording(path) as recording:
        assert recording.facts.id == ""
        assert recording.frames
        assert len(recording.parameter_revisions()) == 1
    with Recording(tmp_path / "within.mcap") as recording:
        assert recording.facts.id == "r1"
    # The run's own recording is complete, and is not continued.
    with Recording(tmp_path / "run.mcap") as recording:
        assert not recording.unfinished


def test_unaligned_motion_capture_topics_state_why_they_are_empty(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    path = tmp_path / "recording.mcap"
    # Nothing listens on that port.
    truth = LiveTruthOrder("vrpn:127.0.0.1:1")
    record = RecordOrder(str(path), "none", "a run")
    bench.sources["live"] = numbered(10_000, live=True)
    bench.value(opening("live", run_id="r1", record=record, truth=truth))
    bench.wait(ObservationEvent, lambda event: event.sequence == 5)
    bench.value(StopRun())
    bench.ask(Shutdown())
    bench._thread.join(PATIENCE_S)
    with Recording(path) as recording:
        frames = [line["frame"] for line in recording.lines()]
        assert list(recording.matched_truth()) == []
    with path.open("rb") as file:
        messages = [(of.topic, told.data) for _, of, told in make_reader(file).iter_messages()]
    told = [json.loads(data) for topic, data in messages if topic == "/truth/matched"]
    assert [each["frame"] for each in told] == frames
    assert all(each["bodies"] == [] for each in told)
    assert all(each["sentence"].startswith("not aligned yet: ") for each in told)
    assert sum(topic == "/scene/truth" for topic, _ in messages) == len(frames)


class Cameras:
    """Frames as fast as they are read, and the other methods of a live source."""

    def __init__(self, source: Any) -> None:
        self._source = source

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def tend(self) -> None:
        pass

    def report(self) -> LiveReport:
        return LiveReport((), self._source.at, 0, None, None, 0)


def test_a_run_reports_reduced_processing_when_cameras_are_too_fast(
    bench: Bench, numbered: Numbered, tmp_path: Path
) -> None:
    path = tmp_path / "r1" / "recording.mcap"
    bench.sources["numbers"] = Cameras(numbered(10_000, live=True, live_interval_s=0.0))
    bench.value(opening(rate=1.0, run_id="r1", record=RecordOrder(str(path), "lossless", "a run")))
    bench.observers[-1].slow_stages = [0.1]
    reduced = bench.wait(StateEvent, lambda s: s.live is not None and s.live.reduced_to)
    assert reduced.live.reduced_to == REDUCTIONS[0].words
    least = REDUCTIONS[0].spacing_px
    assert bench.observers[-1].parameters.klt_tracking.spacing_px == least
    # A manual change acts as far as time permits; the requested values are kept.
    bench.value(SetParameters({"klt_tracking.spacing_px": 12, "flow.window_px": 11}, revision=2))
    assert bench.observers[-1].parameters.flow.window_px == 11
    assert bench.observers[-1].parameters.klt_tracking.spacing_px == least
    bench.value(StopRun())
    with Recording(path) as recording:
        spacings = [
            (r.revision, r.values["klt_tracking.spacing_px"])
            for r in recording.parameter_revisions()
        ]
        assert spacings[:2] == [(1, 18), (1, least)]
        assert all(spacing == least for _, spacing in spacings[1:])
        told = [i.sentence for i in recording.incidents() if i.kind == "processing"]
        assert told[0] == (
            f"the computer is too slow for full processing: reduced to {REDUCTIONS[0].words}"
        )
