"""A source opened to be calibrated waits for that, however it was chosen."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.contract.events import EngineState
from app.server import Server
from app.server.source.hints import is_for_calibrating, source_entries
from app.server.status import status
from app.storage import Storage

from ....waiting import until_async
from ..servers import opens


@pytest.mark.parametrize("spec", ["simulated:calibration", "simulated:calibration?seed=3"])
async def test_a_source_to_calibrate_is_not_opened_at_start_but_shown(
    peer: Any, storage: Storage, spec: str
) -> None:
    server = Server(peer, storage, source=spec)
    try:
        await server.start()
        await until_async(lambda: server.source.generation > 0 and not server.source.restoring)
        await asyncio.sleep(0.05)
        told = status(server)
        assert told.to_calibrate == spec
        assert (told.source, told.engine.state, told.engine.reason) == (None, "idle", None)
        assert opens(peer) == []
        await server.source.open("simulated:lab", None)
        await until_async(lambda: server.source.state.state is EngineState.PREVIEW)
        assert status(server).to_calibrate is None
    finally:
        await server.stop()


async def test_other_sources_are_opened_at_start(server: Any) -> None:
    await until_async(lambda: server.source.state.state is EngineState.PREVIEW)
    assert status(server).to_calibrate is None


def test_sources_to_calibrate_are_those_listed_with_a_board() -> None:
    listed = source_entries(())
    boards = {entry.spec for entry in listed if entry.board is not None}
    assert boards == {entry.spec for entry in listed if is_for_calibrating(entry.spec)}
    assert boards
    for spec in ("camera:0,1", "simulated:", "simulated:no_such", "calibration", ""):
        assert not is_for_calibrating(spec)
