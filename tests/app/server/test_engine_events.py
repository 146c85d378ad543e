"""Lost engines: the next one continues where they were."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.contract.commands import CancelOpening, OpenSource
from app.contract.events import EngineState, StateEvent
from app.server import NotAvailable, Server
from app.server.status import status
from app.storage import RunState, StorageFull

from ...waiting import until_async
from .servers import begin, opens


async def test_the_next_engine_reopens_the_source(peer: Any, server: Server) -> None:
    await server.source.open("a/folder", None)
    peer.lose("the engine did not respond for 1.5 s")
    assert server.source.state.state is EngineState.FAILED
    assert "restarting" in str(server.source.state.reason)
    peer.start_process()
    # Not idle: the loss is reported until the source is back.
    assert server.source.state.state is EngineState.FAILED
    await until_async(lambda: server.source.state.state is EngineState.PREVIEW)
    assert [o.source for o in opens(peer)] == ["simulated:lab", "a/folder", "a/folder"]


async def test_a_run_continues_as_a_new_segment(peer: Any, server: Server) -> None:
    record = await begin(server)
    for _ in range(5):
        peer.observe()
    peer.lose()
    peer.start_process()
    await until_async(lambda: peer.opened is not None)
    assert peer.opened.run_id == record.id
    assert peer.opened.segment == 1
    for _ in range(5):
        peer.observe()
    peer.lose()
    peer.start_process()
    await until_async(lambda: peer.opened is not None and peer.opened.segment == 2)
    ended = await server.runs.stop(record.id)
    assert (ended.state, ended.frames, ended.segments) == (RunState.FINISHED, 10, 3)
    rows = await server.runs.archive.speeds(record.id)
    assert {row.segment for row in rows} == {0, 1}


async def test_a_run_that_kills_every_engine_is_given_up(peer: Any, server: Server) -> None:
    record = await begin(server)
    for _ in range(2):
        peer.lose()
        peer.start_process()
        await until_async(lambda: peer.opened is not None)
    peer.lose()
    peer.start_process()
    await until_async(lambda: server.runs.current is None)
    found = await server.runs.archive.find(record.id)
    assert found.state is RunState.FAILED
    assert "3 times in a row on simulated:lab" in str(found.reason)
    assert peer.opened is None
    assert server.source.state.state is EngineState.FAILED
    await server.source.open("simulated:lab", None)
    assert server.source.state.state is EngineState.PREVIEW


async def test_current_parameters_are_sent_with_the_source(peer: Any, server: Server) -> None:
    await server.parameters.change({"flow.window_px": 21})
    peer.lose()
    peer.start_process()
    await until_async(lambda: peer.opened is not None)
    assert peer.opened.parameters["flow.window_px"] == 21
    assert peer.opened.parameters_revision == 1


async def test_requests_are_refused_while_there_is_no_engine(peer: Any, server: Server) -> None:
    peer.lose()
    with pytest.raises(NotAvailable):
        await server.source.open("x", None)
    with pytest.raises(NotAvailable):
        await begin(server)
    assert server.runs.current is None
    assert await server.runs.archive.newest() == []


def cancelled(peer: Any) -> list[CancelOpening]:
    return [command for command in peer.commands if isinstance(command, CancelOpening)]


class SlowOpening:
    """Lets the peer open sources only once ``gate`` is set."""

    def __init__(self, peer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.gate = asyncio.Event()
        self.asked: list[OpenSource] = []
        self._request = peer.request
        monkeypatch.setattr(peer, "request", self._slowly)
        monkeypatch.setattr("app.server.shared._OPEN_TIMEOUT_S", 0.2)

    async def _slowly(self, command: Any, *args: Any, **more: Any) -> Any:
        if isinstance(command, OpenSource):
            self.asked.append(command)
            await self.gate.wait()
        return await self._request(command, *args, **more)


async def test_a_source_that_does_not_open_is_given_up(
    peer: Any, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowOpening(peer, monkeypatch)
    with pytest.raises(NotAvailable, match=r"a/folder did not open within 0\.2 s"):
        await server.source.open("a/folder", None)
    number = slow.asked[0].opening
    assert number > 0
    assert cancelled(peer) == [CancelOpening(number, "a/folder did not open within 0.2 s")]


async def test_an_opening_that_nobody_waits_for_is_given_up(
    peer: Any, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowOpening(peer, monkeypatch)
    asking = asyncio.create_task(server.source.open("a/folder", None))
    await until_async(lambda: slow.asked)
    asking.cancel()
    with pytest.raises(asyncio.CancelledError):
        await asking
    assert [each.opening for each in cancelled(peer)] == [slow.asked[0].opening]


async def test_the_engine_gives_up_a_run_before_the_run_is_deleted(
    peer: Any, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowOpening(peer, monkeypatch)
    with pytest.raises(NotAvailable, match="did not open"):
        await begin(server)
    assert slow.asked[0].run_id is not None
    assert [each.opening for each in cancelled(peer)] == [slow.asked[0].opening]
    assert await server.runs.archive.newest() == []


async def test_a_run_that_cannot_be_stored_is_ended_in_the_engine(
    peer: Any, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise StorageFull("the disk is full")

    monkeypatch.setattr("app.server.runs.manager.keep_own_calibration", full)
    with pytest.raises(StorageFull):
        await begin(server)
    assert peer.state().run_id is None


async def test_a_preparing_engine_gets_more_time(
    peer: Any, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowOpening(peer, monkeypatch)
    peer.publish(StateEvent(EngineState.IDLE, None, preparing="compiling, which takes a while"))
    assert status(server).engine.reason == "compiling, which takes a while"
    opening = asyncio.create_task(server.source.open("a/folder", None))
    await asyncio.sleep(0.7)
    assert not opening.done()
    slow.gate.set()
    await opening
    assert server.source.state.state is EngineState.PREVIEW
