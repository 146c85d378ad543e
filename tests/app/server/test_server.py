"""The server over a peer engine: restarts, runs that go on, a database that does not answer."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from pathlib import Path
from typing import Any

import pytest

from app.messages import DenseStereoEvent, EngineState, OpenSource, SkippedFrameEvent
from app.server import Conflict, FieldError, NotAvailable, Server
from app.server.runs.current_run import speed_rows
from app.server.status import status
from app.server.telemetry import DenseStereo, Telemetry
from app.server.writer import Writer
from app.storage import RunState, Storage, StorageBusy, StorageError
from observer.errors import ParameterError

from .servers import opens, run, started, until


async def begin(server: Server, **more: Any) -> Any:
    given = {"name": None, "source": None, "calibration_id": None, "preset": None}
    return await server.runs.start(**{**given, "parameters": {}, **more})


# --- engines that are lost ------------------------------------------------------------------


def test_a_lost_engine_is_given_the_source_again(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            await server.source.open("a/folder", None)
            peer.lose("the engine gave no sign of life for 1.5 s")
            assert server.source.state.state is EngineState.FAILED
            assert "being restarted" in str(server.source.state.reason)
            peer.start_process()
            # Not idle: what is missing is told until it is back.
            assert server.source.state.state is EngineState.FAILED
            await until(lambda: server.source.state.state is EngineState.PREVIEW)
            assert [o.source for o in opens(peer)] == ["simulated:lab", "a/folder", "a/folder"]

    run(scenario())


def test_a_run_goes_on_as_a_new_segment(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            record = await begin(server)
            for _ in range(5):
                peer.observe()
            peer.lose()
            peer.start_process()
            await until(lambda: peer.opened is not None)
            assert peer.opened.run_id == record.id
            assert peer.opened.segment == 1
            for _ in range(5):
                peer.observe()
            peer.lose()
            peer.start_process()
            await until(lambda: peer.opened is not None and peer.opened.segment == 2)
            ended = await server.runs.stop(record.id)
            assert (ended.state, ended.frames, ended.segments) == (RunState.FINISHED, 10, 3)
            rows = await server.runs.archive.speeds(record.id)
            assert {row.segment for row in rows} == {0, 1}

    run(scenario())


def test_a_run_that_kills_every_engine_is_given_up(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            record = await begin(server)
            for _ in range(2):
                peer.lose()
                peer.start_process()
                await until(lambda: peer.opened is not None)
            peer.lose()
            peer.start_process()
            await until(lambda: server.runs.current is None)
            found = await server.runs.archive.find(record.id)
            assert found.state is RunState.FAILED
            assert "3 times in a row over simulated:lab" in str(found.reason)
            assert peer.opened is None
            assert server.source.state.state is EngineState.FAILED
            await server.source.open("simulated:lab", None)
            assert server.source.state.state is EngineState.PREVIEW

    run(scenario())


def test_parameters_in_force_go_with_the_source(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            await server.parameters.change({"flow.window_px": 21})
            peer.lose()
            peer.start_process()
            await until(lambda: peer.opened is not None)
            assert peer.opened.parameters["flow.window_px"] == 21
            assert peer.opened.parameters_revision == 1

    run(scenario())


def test_without_an_engine_requests_are_refused_for_the_moment(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            peer.lose()
            with pytest.raises(NotAvailable):
                await server.source.open("x", None)
            with pytest.raises(NotAvailable):
                await begin(server)
            assert server.runs.current is None
            assert await server.runs.archive.newest() == []

    run(scenario())


def test_a_first_source_that_cannot_be_opened_leaves_the_server_up(
    peer: Any, storage: Storage
) -> None:
    async def scenario() -> None:
        async with started(peer, storage, "missing") as server:
            assert server.source.state.state is EngineState.FAILED
            assert "name one that exists" in str(server.source.state.reason)
            await server.source.open("simulated:lab", None)
            assert server.source.state.state is EngineState.PREVIEW

    run(scenario())


# --- runs -----------------------------------------------------------------------------------


def test_a_recordings_run_ends_with_the_recording(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            record = await begin(server, source="a/folder", name="Whole")
            assert peer.opened.loop is False
            peer.observe()
            peer.playback["ended"] = True
            peer.publish(peer.state())
            await until(lambda: server.runs.current is None)
            found = await server.runs.archive.find(record.id)
            assert (found.state, found.frames) == (RunState.FINISHED, 1)
            assert peer.playback["loop"] is True
            # The simulated lab goes on until somebody ends it.
            await begin(server, source="simulated:lab")
            assert peer.opened.loop is True

    run(scenario())


def test_one_run_at_a_time_also_when_asked_at_once(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            results = await asyncio.gather(
                *(begin(server) for _ in range(4)), return_exceptions=True
            )
            assert sum(isinstance(result, Conflict) for result in results) == 3
            assert len(await server.runs.archive.newest()) == 1

    run(scenario())


def test_a_run_snapshots_what_it_was_made_with(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            record = await begin(server, preset="paper", parameters={"flow.window_px": 9})
            assert record.preset is None
            assert record.parameters["flow.window_px"] == 9
            assert record.parameters["matching.method"] == "descriptor"
            assert {"dynamic-observer", "python", "numpy"} <= set(record.versions)
            await server.parameters.change({"flow.window_px": 11})
            await server.runs.stop(record.id)
            changes = await asyncio.to_thread(storage.parameter_revisions, record.id)
            assert [change.difference for change in changes][-1] == {"flow.window_px": 11}

    run(scenario())


def test_bad_parameters_start_no_run_and_stay_out(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            with pytest.raises(ParameterError):
                await begin(server, parameters={"flow.window_px": 1000})
            with pytest.raises(FieldError):
                await begin(server, preset="none")
            assert server.parameters.current.revision == 0
            assert len(opens(peer)) == 1

    run(scenario())


def test_stopping_the_server_marks_the_run(peer: Any, storage: Storage, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            await begin(server)
            peer.observe()

    run(scenario())
    with Storage(tmp_path / "observer.sqlite") as again:
        (record,) = again.list_runs()
        assert (record.state, record.frames) == (RunState.INTERRUPTED, 1)
        assert "stopped" in str(record.reason)


def test_runs_of_a_killed_server_are_interrupted(peer: Any, storage: Storage) -> None:
    with storage:
        storage.create_run(name="x", source="s", parameters={}, versions={})

    async def scenario() -> None:
        async with started(peer, storage) as server:
            (record,) = await server.runs.archive.newest()
            assert record.state is RunState.INTERRUPTED

    run(scenario())


def test_what_was_left_is_found_again(peer: Any, storage: Storage, calibration_yaml: Any) -> None:
    with storage:
        values = {"flow.window_px": 31, "gone.parameter": 1}
        storage.save_parameters(5, values, None)
        record = storage.save_calibration(calibration_yaml(), name="mine", info={})
        storage.activate_calibration(record.id)

    async def scenario() -> None:
        async with started(peer, storage) as server:
            assert server.parameters.current.values.flow.window_px == 31
            assert server.parameters.current.revision == 6
            assert "gone.parameter" in server.shared.warnings[0]
            assert peer.opened.calibration_yaml == calibration_yaml()

    run(scenario())


def test_a_calibration_that_no_longer_fits_is_left_out_and_said(
    peer: Any, storage: Storage, calibration_yaml: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with storage:
        record = storage.save_calibration(calibration_yaml(), name="mine", info={})
        storage.activate_calibration(record.id)
    plain_open = peer._open

    def choosy(command: OpenSource) -> Any:
        if command.calibration_yaml is not None:
            from app.supervisor import EngineRefused

            raise EngineRefused("the calibration is for images of another size", "input")
        return plain_open(command)

    monkeypatch.setattr(peer, "_open", choosy)

    async def scenario() -> None:
        async with started(peer, storage) as server:
            assert server.source.state.state is EngineState.PREVIEW
            assert "mine" in server.shared.warnings[0]
            assert server.source.wanted.calibration is None

    run(scenario())


# --- a database that does not answer ---------------------------------------------------------


def test_a_locked_database_holds_nothing_up(peer: Any, storage: Storage, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            record = await begin(server)
            with_lock = sqlite3.connect(tmp_path / "observer.sqlite", isolation_level=None)
            with_lock.execute("BEGIN IMMEDIATE")
            try:
                longest = 0.0
                for _ in range(60):
                    before = time.monotonic()
                    peer.observe()
                    await asyncio.sleep(0.02)
                    longest = max(longest, time.monotonic() - before)
                # The loop never waited for the lock (its timeout is half a second).
                assert longest < 0.4
                await until(lambda: status(server)["warnings"])
                with pytest.raises(StorageBusy):
                    await server.parameters.save_preset("x", "")
                # Stopping works, whatever the database does.
                ended = await server.runs.stop(record.id)
                assert ended.state is RunState.FINISHED
            finally:
                with_lock.execute("ROLLBACK")
                with_lock.close()
            await until(lambda: not status(server)["warnings"])
            await until(lambda: storage.get_run(record.id).state is RunState.FINISHED)
            assert storage.get_run(record.id).frames == 60
            assert len(storage.speeds(record.id)) == 180
            assert server.shared.writer.dropped == 0

    run(scenario())


def test_the_writers_queue_is_bounded() -> None:
    def busy() -> None:
        raise StorageBusy("locked")

    writer = Writer(queue_length=5, patience_s=60)
    writer.start()
    posted = [writer.post(busy) for _ in range(20)]
    assert posted.count(False) >= 14
    assert writer.dropped == posted.count(False)
    assert writer.trouble == "locked" or writer.trouble is None
    started = time.monotonic()
    writer.stop()
    assert time.monotonic() - started < 5


def test_a_failing_write_ends_neither_the_thread_nor_the_next_write() -> None:
    def full() -> None:
        raise StorageError("no space")

    def broken() -> None:
        raise ZeroDivisionError

    async def scenario() -> None:
        writer = Writer()
        writer.start()
        try:
            with pytest.raises(StorageError):
                await writer.submit(full)
            assert writer.trouble == "no space"
            with pytest.raises(ZeroDivisionError):
                await writer.submit(broken)
            assert await writer.submit(lambda: 5) == 5
            assert writer.trouble is None
        finally:
            await asyncio.to_thread(writer.stop)

    run(scenario())


# --- figures ---------------------------------------------------------------------------------


def test_unique_frames_are_counted_once(peer: Any) -> None:
    peer.start_process()
    peer._open(OpenSource("s", None, {}, 0))
    telemetry = Telemetry()
    now = 0.0
    for _ in range(31):
        event = peer.observe()
        telemetry.observed(event, now)
        # The same frame a second time, as when a source delivers it twice.
        telemetry.observed(event, now)
        now += 0.1
    assert telemetry.rate(now) == pytest.approx(10.0, rel=0.1)
    assert telemetry.rate(now + 10) == 0.0
    assert telemetry.frames_observed == 31
    telemetry.new_engine()
    peer.sequence = 0
    telemetry.observed(peer.observe(), now)
    assert telemetry.frames_observed == 32


def dense(frame: int, received: float, trouble: str | None = None) -> DenseStereoEvent:
    return DenseStereoEvent(frame, received, received + 0.04, 0.03, 1, trouble)


def test_clouds_have_a_rate_and_an_age() -> None:
    telemetry = Telemetry()
    assert telemetry.dense(5.0) == DenseStereo(0.0, None, None, None)
    for frame in range(21):
        telemetry.dense_made(dense(frame, 0.1 * frame), 0.1 * frame + 0.05)
    shown = telemetry.dense(2.05)
    assert shown.per_s == pytest.approx(10.0)
    assert (shown.age_s, shown.median_ms, shown.coarseness) == (0.05, 30.0, 1)
    # Nobody watches any more: the newest only grows old.
    shown = telemetry.dense(6.0)
    assert (shown.per_s, shown.age_s, shown.median_ms) == (0.0, 4.0, None)
    telemetry.new_source()
    assert telemetry.dense(6.0).age_s is None


def test_what_fails_in_dense_stereo_is_a_warning_until_it_works_again(
    peer: Any, storage: Storage
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            peer.publish(dense(1, 0.1, "dense stereo failed: error: no sense"))
            shown = status(server)
            assert "dense stereo failed: error: no sense" in shown["warnings"]
            assert shown["dense_stereo"]["age_s"] is None
            peer.publish(dense(2, 0.2))
            assert status(server)["warnings"] == []

    run(scenario())


def test_percentiles_are_of_the_last_samples() -> None:
    telemetry = Telemetry()
    for ms in range(1, 101):
        telemetry.painted(ms / 1000)
    latency = telemetry.latency
    assert (latency.median, latency.p95, latency.count) == (50.5, 95.0, 100)


def test_skipped_frames_are_told(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as server:
            for index in range(8):
                peer.publish(SkippedFrameEvent(index, "left/0.png is cut off"))
            shown = status(server)["skipped"]
            assert [entry["index"] for entry in shown] == [3, 4, 5, 6, 7]

    run(scenario())


def test_a_coasting_obstacle_is_a_gap(peer: Any) -> None:
    peer.start_process()
    peer._open(OpenSource("s", None, {}, 0))
    event = peer.observe()
    event.line["obstacles"][0]["state"] = "coasting"
    rows = list(speed_rows("run", event))
    assert [(row.source, row.speed) for row in rows] == [
        ("estimate", None),
        ("truth", 0.4),
        ("commanded", 0.4),
    ]
