"""The current run: started, ended, refused."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.server import Conflict, FieldError, Server
from app.server.runs import manager
from app.storage import RunState, Storage
from observer.errors import ParameterError

from ....waiting import until_async
from ..servers import begin, opens


async def test_a_recordings_run_ends_with_the_recording(peer: Any, server: Server) -> None:
    record = await begin(server, source="a/folder", name="Whole")
    assert peer.opened.loop is False
    peer.observe()
    peer.playback["ended"] = True
    peer.publish(peer.state())
    await until_async(lambda: server.runs.current is None)
    found = await server.runs.archive.find(record.id)
    assert (found.state, found.frames) == (RunState.FINISHED, 1)
    assert peer.playback["loop"] is True
    # The simulated lab runs until the run is stopped.
    await begin(server, source="simulated:lab")
    assert peer.opened.loop is True


async def test_concurrent_requests_start_only_one_run(server: Server) -> None:
    results = await asyncio.gather(*(begin(server) for _ in range(4)), return_exceptions=True)
    assert sum(isinstance(result, Conflict) for result in results) == 3
    assert len(await server.runs.archive.newest()) == 1


async def test_a_run_snapshots_its_configuration(storage: Storage, server: Server) -> None:
    record = await begin(server, preset="paper", parameters={"flow.window_px": 9})
    assert record.preset is None
    assert record.parameters["flow.window_px"] == 9
    assert record.parameters["matching.method"] == "descriptor"
    assert {"dynamic-observer", "python", "numpy"} <= set(record.versions)
    await server.parameters.change({"flow.window_px": 11})
    await server.runs.stop(record.id)
    changes = await asyncio.to_thread(storage.parameter_revisions, record.id)
    assert [change.difference for change in changes][-1] == {"flow.window_px": 11}


async def test_bad_parameters_start_no_run_and_are_not_applied(peer: Any, server: Server) -> None:
    with pytest.raises(ParameterError):
        await begin(server, parameters={"flow.window_px": 1000})
    with pytest.raises(FieldError):
        await begin(server, preset="none")
    assert server.parameters.current.revision == 0
    assert len(opens(peer)) == 1


async def test_an_ended_run_returns_its_memory(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    returned: list[bool] = []
    monkeypatch.setattr(manager, "return_freed_memory", lambda: returned.append(True))
    run = await begin(server)
    assert returned == []
    await server.runs.stop(run.id)
    await until_async(lambda: returned == [True])
