"""A supervisor of fake engines, and the events that it publishes."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from app.contract.commands import (
    OpenSource,
)
from app.engine.supervisor import EngineSupervisor
from app.runtime.supervisor_limits import SupervisorLimits

HERE = Path(__file__).parent
FAKE = (sys.executable, str(HERE / "fake_engine.py"))
WORKS = (*FAKE, "works")
PATIENCE_S = 40.0
# No standby engine for tests that do not need one: each process takes a second to start.
ALONE = SupervisorLimits(standby_delay_s=None)
LIMITS = SupervisorLimits(standby_delay_s=0.0)


class Watched:
    """A supervisor and the events it published, with their arrival times."""

    def __init__(
        self, command: tuple[str, ...] | None = WORKS, *, limits: SupervisorLimits = LIMITS
    ) -> None:
        given = {} if command is None else {"command": command}
        self.supervisor = EngineSupervisor(limits=limits, **given)
        self.events: list[tuple[float, Any]] = []
        self.supervisor.subscribe(lambda event: self.events.append((time.monotonic(), event)))

    async def __aenter__(self) -> Watched:
        await self.supervisor.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.supervisor.stop()

    def all(self, kind: type) -> list[Any]:
        return [event for _, event in self.events if isinstance(event, kind)]

    async def wait(self, kind: type, fits: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the first event of this kind that fits, past ones included."""
        return await self.until(
            lambda: next((e for e in self.all(kind) if fits(e)), None), kind.__name__
        )

    async def until(self, found: Callable[[], Any], what: str) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while (result := found()) is None or result is False:
            assert time.monotonic() < deadline, f"{what} did not come: {self.events[-10:]}"
            await asyncio.sleep(0.01)
        return result

    async def standby_ready(self) -> None:
        await self.until(
            lambda: self.supervisor._standby is not None and self.supervisor._standby.ready,
            "the stand-in",
        )


def numbers(source: str = "numbers", **more: Any) -> OpenSource:
    return OpenSource(source, None, {}, 1, **more)


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
