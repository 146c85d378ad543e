"""The server's endless tasks are started again after a failure."""

from __future__ import annotations

from typing import Any

import pytest

from app.http.gate.session_file import SessionFile
from app.http.sockets.live import LiveHub
from app.runtime import endless


async def test_the_live_hub_and_the_session_keeper_survive_a_failure(
    serve: Any, eventually: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endless, "_PAUSE_S", 0.01)
    starts = {LiveHub: 0, SessionFile: 0}

    def fail_once(kind: type[Any], name: str) -> None:
        work = getattr(kind, name)

        async def failing_once(self: Any) -> None:
            starts[kind] += 1
            if starts[kind] == 1:
                raise ValueError("on purpose")
            await work(self)

        monkeypatch.setattr(kind, name, failing_once)

    fail_once(LiveHub, "run")
    fail_once(SessionFile, "keep")
    async with serve():
        await eventually(lambda: min(starts.values()) == 2)
