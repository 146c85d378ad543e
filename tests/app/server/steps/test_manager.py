"""When the process that draws the steps is ended: after the last request, and only once."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from typing import Any

import pytest

from app.runtime.worker import LastingWorker, Worker
from app.server import NotAvailable, Server
from app.server.steps import manager as manager_module
from app.server.steps.manager import MethodStepsManager, PairChoice
from app.storage import Storage
from app.workers.steps.messages import DrawStep, StepsAnswer

from ....waiting import until_async


class Drawer(LastingWorker):
    """Worker without a process, which answers as soon as the test lets it."""

    def __init__(self) -> None:
        super().__init__(Worker("none", 0), longest_s=1.0)
        self.answers = threading.Semaphore(0)
        self.asked = 0
        self.closed = 0

    def do(self, job: object, kind: type[Any]) -> Any:
        assert isinstance(job, DrawStep)
        assert kind is StepsAnswer
        self.asked += 1
        assert self.answers.acquire(timeout=20)
        return StepsAnswer(b"a picture")

    def end(self) -> None:
        self.answers.release(100)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def drawers() -> list[Drawer]:
    """The workers made so far."""
    return []


@pytest.fixture
async def steps(
    server: Server, storage: Storage, drawers: list[Drawer], monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[MethodStepsManager]:
    monkeypatch.setattr(manager_module, "_IDLE_S", 0.2)

    def drawer() -> Drawer:
        drawers.append(Drawer())
        return drawers[-1]

    made = MethodStepsManager(storage, server.source, server.parameters, lambda: False, drawer)
    yield made
    await made.close()


async def picture(steps: MethodStepsManager, frame: int) -> bytes:
    choice = PairChoice("simulated:lab", frame, "paper", {})
    return await steps.file(choice, 4, "png", dark=False, labelled=False)


async def test_the_process_is_idle_only_after_the_last_of_overlapping_requests(
    steps: MethodStepsManager, drawers: list[Drawer]
) -> None:
    requests = [asyncio.create_task(picture(steps, frame)) for frame in (20, 30)]
    await until_async(lambda: drawers and drawers[0].asked == 1)
    drawers[0].answers.release()
    await requests[0]
    # The second request takes longer than the process may be idle.
    await asyncio.sleep(0.6)
    third = asyncio.create_task(picture(steps, 40))
    drawers[0].answers.release(2)
    await asyncio.gather(requests[1], third)
    assert len(drawers) == 1
    assert drawers[0].closed == 0
    await until_async(lambda: drawers[0].closed)
    await asyncio.sleep(0.6)
    assert drawers[0].closed == 1


async def test_nothing_is_left_to_end_the_process_of_a_closed_manager(
    steps: MethodStepsManager, drawers: list[Drawer]
) -> None:
    failures: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context))
    requests = [asyncio.create_task(picture(steps, frame)) for frame in (20, 30)]
    await until_async(lambda: drawers and drawers[0].asked == 1)
    drawers[0].answers.release(2)
    await asyncio.gather(*requests)
    await steps.close()
    await steps.close()
    assert drawers[0].closed == 1
    with pytest.raises(NotAvailable, match="shutting down"):
        await picture(steps, 50)
    await asyncio.sleep(0.4)
    assert failures == []
