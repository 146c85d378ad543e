"""Engines that die, hang or cannot be looked after: replaced, with the reason."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from app.contract.commands import (
    WatchViews,
)
from app.contract.events import (
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    HeartbeatEvent,
    ObservationEvent,
    StateEvent,
)
from app.runtime.errors import ProcessUnavailable
from app.runtime.supervisor_limits import SupervisorLimits

from ..starvation import others_at_work
from .supervised import ALONE, PATIENCE_S, Watched, gone, numbers

# Seconds: the promised time, plus some for a machine that runs other tests.
REPLACED_WITHIN_S = 2.0 + 0.5


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP])
async def test_a_dead_or_hung_engine_is_replaced_in_time(number: signal.Signals) -> None:
    async with Watched() as watched:
        supervisor = watched.supervisor
        await supervisor.request(numbers())
        await watched.standby_ready()
        first = supervisor.health.pid
        assert first is not None
        begin = time.monotonic()
        os.kill(first, number)
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 2)
        at = {type(e): t for t, e in watched.events if t > begin}
        assert at[EngineStartedEvent] - begin < REPLACED_WITHIN_S
        lost = watched.all(EngineLostEvent)[0]
        assert lost.generation == 1
        expected = "did not respond" if number == signal.SIGSTOP else number.name
        assert expected in lost.reason
        order = [type(e) for _, e in watched.events if not isinstance(e, HeartbeatEvent)]
        assert order.index(EngineLostEvent) < len(order) - order[::-1].index(EngineStartedEvent)
        assert gone(first)
        health = supervisor.health
        assert health.restarts == 1
        assert health.pid != first
        # The next engine is idle and works like the first one.
        assert watched.all(StateEvent)[-1].state is EngineState.IDLE
        await supervisor.request(numbers())
        sequence = supervisor.views["plain"].read()
        await supervisor.request(WatchViews(("plain",)))
        await watched.until(
            lambda: supervisor.views["plain"].read(sequence.sequence if sequence else 0),
            "a picture of the next engine",
        )


async def test_a_hung_main_loop_is_replaced_although_its_threads_live() -> None:
    async with Watched() as watched:
        await watched.standby_ready()
        begin = time.monotonic()
        await watched.supervisor.request(numbers("hang"))
        await watched.wait(EngineLostEvent)
        assert "did not respond" in watched.all(EngineLostEvent)[0].reason
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 2)
        assert time.monotonic() - begin < REPLACED_WITHIN_S + 0.5


@pytest.mark.patient
async def test_an_engine_starved_of_processor_time_is_not_replaced() -> None:
    longest = 0.0
    async with Watched(limits=ALONE) as watched:
        pid = watched.supervisor.health.pid
        assert pid is not None
        await watched.supervisor.request(numbers("busy"))
        await watched.wait(ObservationEvent)
        with others_at_work(pid):
            until = time.monotonic() + 8.0
            while time.monotonic() < until:
                longest = max(longest, watched.supervisor.health.heartbeat_age_s or 0.0)
                await asyncio.sleep(0.05)
            assert watched.all(EngineLostEvent) == []
        assert watched.supervisor.health.restarts == 0
    sys.stdout.write(f"silent for {longest:.1f} s at most\n")
    # Otherwise the machine was not busy enough, and nothing was tested.
    assert longest > SupervisorLimits().hang_s


async def test_a_request_to_a_dying_engine_fails_immediately() -> None:
    async with Watched(limits=ALONE) as watched:
        begin = time.monotonic()
        with pytest.raises(
            ProcessUnavailable, match="before it completed the request to open source"
        ):
            await watched.supervisor.request(numbers("exit"), timeout_s=30)
        assert time.monotonic() - begin < 10
        await watched.wait(EngineLostEvent)
        assert "exit code 7" in watched.all(EngineLostEvent)[0].reason


async def test_a_repeatable_request_is_answered_by_the_next_engine(tmp_path: Path) -> None:
    async with Watched() as watched:
        supervisor = watched.supervisor
        await watched.standby_ready()
        opened = await supervisor.request(numbers(str(tmp_path / "once")), repeatable=True)
        assert opened.state.state == "preview"
        assert supervisor.health.generation == 2
        # A source that ends every engine is tried twice, not forever.
        with pytest.raises(ProcessUnavailable, match="exited before it completed"):
            await supervisor.request(numbers("exit"), repeatable=True)
        assert supervisor.health.generation in (3, 4)
        # While there is no engine, the request waits for one.
        assert (await supervisor.request(numbers(), repeatable=True)).state.state == "preview"


async def test_an_engine_that_keeps_dying_is_restarted_with_backoff() -> None:
    limits = SupervisorLimits(standby_delay_s=0.0, backoff_s=0.2)
    async with Watched(limits=limits) as watched:

        def open_deadly(event: Any) -> None:
            if isinstance(event, EngineStartedEvent):
                deadly.append(asyncio.create_task(watched.supervisor.request(numbers("exit"))))

        await watched.standby_ready()
        deadly: list[asyncio.Task[Any]] = []
        unsubscribe = watched.supervisor.subscribe(open_deadly)
        open_deadly(EngineStartedEvent(1, 0))
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 4)
        unsubscribe()
        await asyncio.gather(*deadly, return_exceptions=True)
        starts = [t for t, e in watched.events if isinstance(e, EngineStartedEvent)]
        losses = [t for t, e in watched.events if isinstance(e, EngineLostEvent)]
        pauses = [start - lost for start, lost in zip(starts[1:], losses, strict=False)]
        assert pauses[0] < REPLACED_WITHIN_S, "a single death is made good at once"
        assert pauses[1] >= 0.2
        assert pauses[2] >= 0.4


async def test_an_engine_that_cannot_be_looked_after_is_not_healthy_and_replaced_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with Watched(limits=ALONE) as watched:
        supervisor = watched.supervisor
        first = supervisor.health
        assert first.alive
        with monkeypatch.context() as patch:
            patch.setattr(supervisor, "_complaint", _fail)
            await watched.until(lambda: not supervisor.health.alive, "the doubt")
            assert supervisor.health.pid == first.pid
            assert first.pid is not None
            os.kill(first.pid, signal.SIGKILL)
            await asyncio.sleep(0.3)
            assert caplog.text.count("supervising the engine failed: on purpose") == 1
        await watched.wait(EngineLostEvent)
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
        await watched.until(lambda: supervisor.health.alive, "the next engine")
        assert supervisor._watching is not None
        # By whatever means supervision ends, the engine is then no longer called healthy.
        supervisor._watching.cancel()
        await watched.until(lambda: not supervisor.health.alive, "the doubt")


@pytest.mark.parametrize("broken", ["ChildProcess.start", "ProcessSupervisor._look_after_active"])
async def test_a_start_ends_even_if_supervision_fails(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"app.runtime.supervisor.{broken}", _fail)
    watched = Watched(limits=SupervisorLimits(backoff_s=0.01))
    with pytest.raises(ProcessUnavailable, match=r"on purpose, 3 times in a row"):
        async with asyncio.timeout(PATIENCE_S):
            await watched.supervisor.start()
    assert not watched.supervisor.health.alive


async def test_the_loss_of_an_engine_that_cannot_be_ended_is_published(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with Watched(limits=ALONE) as watched:
        child = watched.supervisor._active
        assert child is not None
        with monkeypatch.context() as patch:
            patch.setattr("app.runtime.child.ChildProcess.remove", _fail)
            child.kill()
            lost = await watched.wait(EngineLostEvent)
            assert lost.reason == "the engine cannot be ended: on purpose"
        await child.remove()
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
        # It was not forgotten.
        assert gone(child.pid)
        assert child not in watched.supervisor._lingering


async def test_an_engine_whose_messages_cannot_be_handled_is_replaced_with_the_cause_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with Watched(limits=ALONE) as watched:
        monkeypatch.setattr(watched.supervisor._active, "_on_event", _fail)
        await watched.wait(EngineLostEvent)
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
    assert "RuntimeError: on purpose" in caplog.text


def _fail(*_: Any, **__: Any) -> Any:
    raise RuntimeError("on purpose")
