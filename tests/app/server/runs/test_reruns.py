"""Re-runs beside the open source: in order, held, cancelled, failed, ended with the server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import app.server.runs.reruns as reruns_module
from app.runtime.jobs import Progress
from app.runtime.worker import JobFailed
from app.server import Conflict, FieldError, NotThere, Server
from app.storage import RunRecord, RunState, Storage
from app.workers.frame_results import FrameResult, result_line
from app.workers.rerun.messages import Rerun, Rerunned

from ....waiting import until_async
from ..servers import begin, opens, started

RESULT = FrameResult(
    2.0,
    0,
    [{"id": 3, "state": "confirmed", "velocity_time": 2.0, "speed": 0.4, "speed_std": 0.01}],
    [],
    offset_s=0.5,
)


class Workers:
    """Stands in for the worker: each job waits until it is released."""

    def __init__(self) -> None:
        self.jobs: list[Rerun] = []
        self.held: Callable[[], bool] = lambda: False
        self.progress: Callable[[Progress], None] = lambda _: None
        self.done = asyncio.Event()
        self.refusal: str | None = None

    async def run(
        self, job: Rerun, progress: Callable[[Progress], None], held: Callable[[], bool]
    ) -> Rerunned:
        self.jobs.append(job)
        self.progress, self.held = progress, held
        await self.done.wait()
        if self.refusal is not None:
            raise JobFailed(self.refusal)
        Path(job.results).write_bytes(result_line(RESULT))
        Path(job.output).write_bytes(b"a recording")
        return Rerunned(30, 2, 1.5, 4.0, 11, 0)


@pytest.fixture
async def workers(monkeypatch: pytest.MonkeyPatch) -> Workers:
    made = Workers()
    monkeypatch.setattr(reruns_module, "rerun_in_worker", made.run)
    return made


async def recorded(server: Server) -> RunRecord:
    """A finished run; only the worker notices that its recording is not one."""
    record = await begin(server, name="Walk", parameters={"ego_motion.ransac_threshold_px": 2.0})
    await server.runs.stop(record.id)
    folder = server.storage.folder.run(record.id)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recording.mcap").touch()
    return record


async def rerun(server: Server, run_id: str, **more: Any) -> RunRecord:
    given: dict[str, Any] = {"name": None, "preset": None, "parameters": {}}
    return await server.runs.rerun(run_id, **given | more)


async def test_a_rerun_changes_nothing_live(server: Server, workers: Workers, peer: Any) -> None:
    original = await recorded(server)
    opened, before = len(opens(peer)), server.parameters.current
    again = await rerun(server, original.id, preset="paper")
    assert (again.name, again.rerun_of) == ("Walk (re-run)", original.id)
    assert (again.state, again.preset, again.record) == (RunState.RUNNING, "paper", "none")
    await until_async(lambda: workers.jobs)
    (job,) = workers.jobs
    assert job.images.endswith(f"{original.id}/recording.mcap")
    assert job.parameters["matching.method"] == "descriptor"
    # A live run goes on beside it.
    live = await begin(server, name="Live")
    with pytest.raises(Conflict, match="not finished"):
        await server.runs.archive.recording(again.id)
    with pytest.raises(Conflict, match="delete it"):
        await server.runs.stop(again.id)
    workers.done.set()
    await until_async(lambda: not server.runs.reruns.facts())
    assert server.runs.current is not None
    await server.runs.stop(live.id)
    ended = await server.runs.archive.find(again.id)
    assert (ended.state, ended.frames, ended.segments) == (RunState.FINISHED, 30, 2)
    assert (ended.begin_s, ended.duration_s, ended.recording_bytes) == (1.5, 4.0, 11)
    (row,) = server.storage.speeds(again.id)
    assert (row.time, row.track_id, row.speed, row.std) == (2.5, 3, 0.4, 0.01)
    assert not Path(job.results).exists()
    assert server.parameters.current == before
    # Only the live run opened a source.
    assert [each.run_id for each in opens(peer)[opened:]] == [live.id]


async def test_a_rerun_starts_from_the_runs_parameters_and_refuses_bad_ones(
    server: Server, workers: Workers
) -> None:
    original = await recorded(server)
    await server.parameters.change({"ego_motion.ransac_threshold_px": 5.0})
    again = await rerun(server, original.id, parameters={"tracking.gate": 4})
    assert again.parameters["ego_motion.ransac_threshold_px"] == 2.0
    assert again.parameters["tracking.gate"] == 4
    with pytest.raises(FieldError, match="no preset"):
        await rerun(server, original.id, preset="none")
    with pytest.raises(NotThere):
        await rerun(server, "20200101-000000-abcdef")
    assert len(workers.jobs) <= 1


async def test_reruns_run_one_at_a_time_and_yield_to_an_armed_robot(
    server: Server, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = await recorded(server)
    first = await rerun(server, original.id)
    second = await rerun(server, original.id, name="second")
    await until_async(lambda: workers.jobs)
    # Time enough for the second one to begin, if it could.
    await asyncio.sleep(0.05)
    assert len(workers.jobs) == 1
    workers.progress(Progress("observing", 0.25))
    facts = server.runs.reruns.facts()
    assert [(each.id, each.state, each.share) for each in facts] == [
        (first.id, "observing", 0.25),
        (second.id, "waiting", 0.0),
    ]
    monkeypatch.setattr(server.driving, "is_driven", lambda role: role == "obstacle")
    assert workers.held()
    assert server.runs.reruns.facts()[0].state == "held"
    monkeypatch.undo()
    assert not workers.held()


async def test_a_cancelled_rerun_leaves_nothing(server: Server, workers: Workers) -> None:
    original = await recorded(server)
    first, second = await rerun(server, original.id), await rerun(server, original.id)
    await until_async(lambda: workers.jobs)
    await server.runs.delete(first.id)
    assert server.storage.get_run(first.id) is None
    assert not server.storage.folder.run(first.id).exists()
    await until_async(lambda: len(workers.jobs) == 2)
    assert [each.id for each in server.runs.reruns.facts()] == [second.id]
    workers.done.set()
    await until_async(lambda: not server.runs.reruns.facts())
    assert (await server.runs.archive.find(second.id)).state is RunState.FINISHED


async def test_a_failed_rerun_states_the_reason(server: Server, workers: Workers) -> None:
    original = await recorded(server)
    workers.refusal = "recording.mcap is damaged"
    workers.done.set()
    again = await rerun(server, original.id)
    await until_async(lambda: not server.runs.reruns.facts())
    ended = await server.runs.archive.find(again.id)
    assert (ended.state, ended.reason) == (RunState.FAILED, workers.refusal)


async def test_a_rerun_is_interrupted_when_the_server_stops(
    peer: Any, storage: Storage, workers: Workers, tmp_path: Path
) -> None:
    async with started(peer, storage) as server:
        again = await rerun(server, (await recorded(server)).id)
        await until_async(lambda: workers.jobs)
    with Storage(tmp_path / "observer.sqlite") as kept:
        record = kept.get_run(again.id)
        assert record is not None
        assert record.state is RunState.INTERRUPTED
        assert "stopped" in str(record.reason)
