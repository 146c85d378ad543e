"""The supervisor with real processes: fake sources at the wire."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from app.contract.commands import (
    SetParameters,
    StopRun,
    WatchViews,
)
from app.contract.events import (
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    ObservationEvent,
    StateEvent,
)
from app.engine.supervisor import EngineSupervisor
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.supervisor_limits import SupervisorLimits

from .supervised import ALONE, FAKE, HERE, Watched, gone, numbers


async def test_it_starts_answers_observes_and_leaks_no_descriptors() -> None:
    # Collect garbage of earlier tests first, or its descriptors would be counted.
    gc.collect()
    before = len(os.listdir("/dev/fd"))
    async with Watched() as watched:
        supervisor = watched.supervisor
        assert [type(event) for _, event in watched.events[:2]] == [EngineStartedEvent, StateEvent]
        health = supervisor.health
        assert (health.generation, health.alive, health.restarts) == (1, True, 0)
        assert health.pid is not None
        assert health.heartbeat_age_s is not None
        assert health.heartbeat_age_s < 2
        value = await supervisor.request(numbers())
        assert value.state.state == "preview"
        assert watched.all(StateEvent)[-1].state is EngineState.PREVIEW
        await watched.wait(ObservationEvent, lambda e: e.sequence == 20)
        sequences = [e.sequence for e in watched.all(ObservationEvent)]
        assert sequences == list(range(len(sequences)))
        assert await supervisor.request(WatchViews(("plain",))) is None
        latest = await watched.until(supervisor.views["plain"].read, "a picture")
        assert latest.payload.startswith(b"\xff\xd8")
        assert supervisor.cloud.read() is None
        await watched.standby_ready()
    await supervisor.stop()
    assert len(os.listdir("/dev/fd")) == before


async def test_refusals_are_distinguished_from_unavailability() -> None:
    async with Watched(limits=ALONE) as watched:
        supervisor = watched.supervisor
        with pytest.raises(ProcessRefused, match="no run is in progress") as refused:
            await supervisor.request(StopRun())
        assert refused.value.refusal == "state"
        with pytest.raises(ProcessRefused, match="there is no such parameter") as refused:
            await supervisor.request(SetParameters({"a.b": 1}, 1))
        assert refused.value.refusal == "input"
    with pytest.raises(ProcessUnavailable, match="is shutting down"):
        await supervisor.request(StopRun())


async def test_an_unanswered_request_times_out() -> None:
    limits = SupervisorLimits(hang_s=30, standby_delay_s=None)
    async with Watched(limits=limits) as watched:
        pid = watched.supervisor.health.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(ProcessUnavailable, match="not complete the request to stop run within"):
            await watched.supervisor.request(StopRun(), timeout_s=0.3)
        begin = time.monotonic()
    # Stopping the supervisor also ends an engine that is stopped by SIGSTOP.
    assert gone(pid)
    assert time.monotonic() - begin < 10


async def test_an_engine_that_never_starts_is_given_up_with_the_reason() -> None:
    dies = (sys.executable, "-c", "exit(3)")
    watched = Watched(dies, limits=SupervisorLimits(backoff_s=0.05))
    with pytest.raises(ProcessUnavailable, match="exit code 3, 3 times in a row"):
        await watched.supervisor.start()


async def test_a_silent_engine_is_given_up() -> None:
    silent = (sys.executable, "-c", "import time; time.sleep(3600)")
    watched = Watched(silent, limits=SupervisorLimits(start_s=0.4, backoff_s=0.05))
    with pytest.raises(ProcessUnavailable, match="did not respond"):
        await watched.supervisor.start()


async def test_a_missing_program_is_reported() -> None:
    supervisor = EngineSupervisor(
        command=("/nowhere/python",), limits=SupervisorLimits(backoff_s=0.05)
    )
    with pytest.raises(ProcessUnavailable, match=r"cannot be started: .*No such file"):
        await supervisor.start()


async def test_a_blocked_event_loop_is_not_mistaken_for_a_hung_engine() -> None:
    async with Watched(limits=ALONE) as watched:
        await watched.supervisor.request(numbers())
        pid = watched.supervisor.health.pid
        time.sleep(2.5)
        await asyncio.sleep(0.5)
        assert watched.supervisor.health.pid == pid
        assert watched.all(EngineLostEvent) == []
        # 50 frames/s for 2.5 s exceed the queue: the lost ones must be counted.

        def counted() -> bool:
            sequences = [e.sequence for e in watched.all(ObservationEvent)]
            missing = sequences[-1] + 1 - len(sequences)
            return missing == watched.supervisor.health.observations_lost

        await watched.until(counted, "the count of what was lost")


async def test_a_failing_listener_does_not_affect_others() -> None:
    async with Watched(limits=ALONE) as watched:

        def failing(_: Any) -> None:
            raise ValueError("on purpose")

        watched.supervisor.subscribe(failing)
        heard: list[Any] = []
        unsubscribe = watched.supervisor.subscribe(heard.append)
        await watched.until(lambda: len(heard) > 3, "events behind a failing listener")
        unsubscribe()
        count = len(heard)
        await asyncio.sleep(0.2)
        assert len(heard) == count


@pytest.mark.parametrize(
    ("number", "stopped", "behaviour"),
    [
        (signal.SIGTERM, False, "works"),
        (signal.SIGTERM, True, "works"),
        (signal.SIGKILL, False, "works"),
        (signal.SIGKILL, False, "channel-only"),
        # A stopped process cannot run its own code: only the kernel can end it.
        pytest.param(
            signal.SIGKILL,
            True,
            "works",
            marks=pytest.mark.skipif(sys.platform != "linux", reason="needs PR_SET_PDEATHSIG"),
        ),
    ],
)
def test_engines_end_with_their_parent(
    number: signal.Signals, stopped: bool, behaviour: str
) -> None:
    parent = subprocess.Popen(
        [sys.executable, str(HERE / "serving_parent.py"), *FAKE, behaviour],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[2])},
    )
    try:
        assert parent.stdout is not None
        engines = [int(word) for word in parent.stdout.readline().split()]
        assert len(engines) == 2
        if stopped:
            for pid in engines:
                os.kill(pid, signal.SIGSTOP)
        parent.send_signal(number)
        code = parent.wait(20)
        assert code == (-signal.SIGKILL if number == signal.SIGKILL else 0)
        deadline = time.monotonic() + 5
        while not all(map(gone, engines)):
            assert time.monotonic() < deadline, "an engine outlived its parent"
            time.sleep(0.01)
    finally:
        parent.kill()
        parent.wait()
        assert parent.stdout is not None
        parent.stdout.close()
