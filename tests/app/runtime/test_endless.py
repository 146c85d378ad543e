"""Endless work goes on after a failure."""

from __future__ import annotations

import asyncio

import pytest

from app.runtime import endless
from app.runtime.endless import keep_running


async def test_failed_work_is_logged_and_started_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(endless, "_PAUSE_S", 0.01)
    started, going = 0, asyncio.Event()

    async def work() -> None:
        nonlocal started
        started += 1
        if started < 3:
            raise ValueError("on purpose")
        going.set()
        await asyncio.Event().wait()

    running = asyncio.create_task(keep_running(work, "clerk"))
    async with asyncio.timeout(5):
        await going.wait()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    assert started == 3
    assert caplog.text.count("the clerk failed and is started again") == 2
    assert caplog.text.count("ValueError: on purpose") == 2
