"""Keeps one engine process at work: starts it, hears it, replaces it when it dies or hangs.

A second engine stands by, started and idle, because starting one takes longer on a busy machine
than the two seconds within which a lost one must be replaced.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.channel.latest import LatestReader, create_slot
from app.engine.launch import ENGINE_COMMAND, EngineEnded, EngineProcess
from app.messages import (
    CLOUD_NAME,
    VIEW_NAMES,
    Command,
    EngineLostEvent,
    EngineStartedEvent,
    Event,
    Shutdown,
)
from app.processes.errors import ProcessRefused, ProcessUnavailable

_log = logging.getLogger(__name__)

# A JPEG of 1280 pixels width stays below 1 MB, 20000 points take 300 KB; memory is only taken
# as far as values reach.
_SLOT_BYTES = 4 * 1024 * 1024


class EngineRefused(ProcessRefused):
    """The engine answered that it will not or could not."""


class EngineUnavailable(ProcessUnavailable):
    """There is no engine that could answer at this moment."""


@dataclass(frozen=True)
class SupervisorLimits:
    """The supervisor's times, seconds.

    Attributes:
        hang_s: an engine silent for this long is taken for hung. Beats come every 0.05 s, and
            between an observer's stages; what remains up to 2 s is for replacing it.
        start_s: a starting engine that says nothing for this long is taken for hung.
        tick_s: how often silence is looked at.
        standby_delay_s: how long after an engine started its stand-in is started, or None for
            no stand-in: then replacing takes as long as a start.
        quick_death_s: an engine that lived shorter than this counts as a failed attempt.
        backoff_s: pause before the third attempt in a row, doubled with each further one.
        most_backoff_s: the longest pause.
        attempts: so many failed attempts in a row let ``start`` give up.
        stop_s: how long an engine is given to leave by itself.
    """

    hang_s: float = 1.6
    start_s: float = 30.0
    tick_s: float = 0.05
    standby_delay_s: float | None = 3.0
    quick_death_s: float = 5.0
    backoff_s: float = 0.5
    most_backoff_s: float = 10.0
    attempts: int = 3
    stop_s: float = 1.0


@dataclass(frozen=True)
class EngineHealth:
    """How the engine is.

    Attributes:
        generation: number of engines so far, the present one included.
        pid: None while there is none.
        restarts: how often one was replaced.
        heartbeat_age_s: since the loop's last sign of life; None while there is no engine.
        observations_lost: dropped because this process was slow, over all engines.
    """

    generation: int
    pid: int | None
    alive: bool
    restarts: int
    heartbeat_age_s: float | None
    observations_lost: int


class Supervisor:
    """Owns the engine processes. All methods belong to the event loop's thread.

    ``views`` and ``cloud`` read the latest images and cloud of whichever engine writes them.
    """

    def __init__(
        self,
        *,
        command: Sequence[str] = ENGINE_COMMAND,
        limits: SupervisorLimits | None = None,
    ) -> None:
        """
        Args:
            command: starts an engine; its arguments are put behind it.
        """
        self._command = tuple(command)
        self._limits = limits or SupervisorLimits()
        self._slots = {name: create_slot(_SLOT_BYTES) for name in (*VIEW_NAMES, CLOUD_NAME)}
        readers = {name: LatestReader(fd) for name, fd in self._slots.items()}
        self.cloud: LatestReader = readers.pop(CLOUD_NAME)
        self.views: Mapping[str, LatestReader] = readers
        self._subscribers: list[Callable[[Event], None]] = []
        self._active: EngineProcess | None = None
        # Started, and not yet (or never) needed: the stand-in, or the next engine on its way.
        self._standby: EngineProcess | None = None
        # Killed, but not gone yet.
        self._lingering: list[EngineProcess] = []
        self._active_since = 0.0
        self._generation = 0
        self._lost_before = 0
        self._failures = 0
        self._not_before = 0.0
        self._trouble = "the engine is being started"
        self._wake = asyncio.Event()
        self._first: asyncio.Future[None] | None = None
        self._watching: asyncio.Task[None] | None = None
        self._closed = False

    # --- what others use -------------------------------------------------------------------

    async def start(self) -> None:
        """Start the first engine and wait until it is ready.

        Raises:
            EngineUnavailable: it ended in all attempts; nothing is left running.
        """
        if self._watching is not None or self._closed:
            raise RuntimeError("a supervisor is started once")
        self._first = asyncio.get_running_loop().create_future()
        self._watching = asyncio.create_task(self._watch(), name="watch the engine")
        try:
            await asyncio.shield(self._first)
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """End every engine and release all memory; safe to call twice."""
        if self._closed:
            return
        self._closed = True
        if self._watching is not None:
            # Not cancelled: it may hold an engine that it is about to start or to remove.
            self._wake.set()
            await asyncio.gather(self._watching, return_exceptions=True)
        engines = [engine for engine in (self._active, self._standby) if engine is not None]
        self._active = self._standby = None
        await asyncio.gather(*(self._end(engine) for engine in engines))
        for engine in self._lingering:
            if not await engine.wait_gone(self._limits.stop_s):
                _log.error("engine process %d hangs inside the kernel", engine.pid)
        for reader in (self.cloud, *self.views.values()):
            reader.close()
        for fd in self._slots.values():
            os.close(fd)

    async def request(self, command: Command, timeout_s: float = 10.0) -> dict[str, Any]:
        """Ask the engine and wait for its answer's value.

        Raises:
            EngineRefused: it says no, and why.
            EngineUnavailable: there is none, it ended meanwhile or did not answer in time.
        """
        engine = self._active
        if self._closed:
            raise EngineUnavailable("the server is being stopped")
        if engine is None:
            raise EngineUnavailable(self._trouble)
        what = type(command).__name__
        try:
            reply = await engine.request(command, timeout_s)
        except TimeoutError:
            raise EngineUnavailable(
                f"the engine did not answer {what} within {timeout_s:g} s"
            ) from None
        except EngineEnded:
            raise EngineUnavailable(f"the engine ended before it answered {what}") from None
        if reply.refusal is not None:
            raise EngineRefused(reply.error or f"{what} was refused", reply.refusal)
        return reply.value or {}

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call ``callback`` in the event loop for every event, in order.

        Returns:
            What ends the subscription.
        """
        self._subscribers.append(callback)

        def unsubscribe() -> None:
            if callback in self._subscribers:
                self._subscribers.remove(callback)

        return unsubscribe

    @property
    def health(self) -> EngineHealth:
        engine = self._active
        heartbeat = None if engine is None else engine.heartbeat
        return EngineHealth(
            generation=self._generation,
            pid=None if engine is None else engine.pid,
            alive=engine is not None,
            restarts=max(0, self._generation - 1),
            heartbeat_age_s=(
                None if heartbeat is None else max(0.0, time.monotonic() - heartbeat.monotonic)
            ),
            observations_lost=self._lost_before + _lost(engine),
        )

    # --- watching --------------------------------------------------------------------------

    async def _watch(self) -> None:
        looked = time.monotonic()
        while not self._closed:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._limits.tick_s):
                    await self._wake.wait()
            self._wake.clear()
            now = time.monotonic()
            # While this event loop itself stood still, nobody could be heard: that is not the
            # engines' silence.
            passed, looked = min(now - looked, 2 * self._limits.tick_s), now
            for engine in (self._active, self._standby):
                if engine is not None:
                    engine.silent_s += passed
            self._lingering = [engine for engine in self._lingering if not engine.reap()]
            await self._look_after_active()
            if not self._closed:
                await self._look_after_standby()

    async def _look_after_active(self) -> None:
        engine = self._active
        if engine is None:
            return
        complaint = self._complaint(engine)
        if complaint is None:
            if time.monotonic() - self._active_since >= self._limits.quick_death_s:
                self._failures = 0
            return
        self._active = None
        self._lost_before += _lost(engine)
        self._trouble = f"the engine {complaint} and is being replaced"
        ending = await self._remove(engine)
        reason = f"the engine {ending if complaint == _ENDED else complaint}"
        _log.error("%s", reason)
        self._count_failure(self._active_since)
        self._publish(EngineLostEvent(self._generation, reason))

    async def _look_after_standby(self) -> None:
        now = time.monotonic()
        engine = self._standby
        if engine is None:
            if self._wants_another(now):
                await self._start_another()
            return
        complaint = self._complaint(engine)
        if complaint is not None:
            self._standby = None
            ending = await self._remove(engine)
            self._trouble = f"a starting engine {ending if complaint == _ENDED else complaint}"
            _log.error("%s", self._trouble)
            self._count_failure(engine.started)
            self._give_up_start()
        elif engine.ready and self._active is None and now >= self._not_before:
            self._active, self._standby = engine, None
            self._active_since = now
            self._generation += 1
            self._publish(EngineStartedEvent(self._generation, engine.pid))
            if engine.last_state is not None:
                self._publish(engine.last_state)
            if self._first is not None and not self._first.done():
                self._first.set_result(None)

    def _wants_another(self, now: float) -> bool:
        if self._active is None:
            return now >= self._not_before
        delay = self._limits.standby_delay_s
        return delay is not None and now >= max(self._active_since + delay, self._not_before)

    async def _start_another(self) -> None:
        try:
            self._standby = await EngineProcess.start(self._command, self._slots, self._hear)
        except OSError as error:
            self._trouble = f"the engine cannot be started: {error}"
            _log.error("%s", self._trouble)
            self._count_failure(time.monotonic())
            self._give_up_start()

    def _complaint(self, engine: EngineProcess) -> str | None:
        """What is wrong with an engine, in words that go on from its name."""
        if engine.ended:
            return _ENDED
        limit = self._limits.hang_s if engine.ready else self._limits.start_s
        if engine.silent_s > limit:
            return f"gave no sign of life for {engine.silent_s:.1f} s"
        return None

    def _count_failure(self, since: float) -> None:
        """Pause longer and longer where one engine after the other ends quickly."""
        now = time.monotonic()
        self._failures = self._failures + 1 if now - since < self._limits.quick_death_s else 1
        pause = 0.0
        if self._failures > 1:
            pause = min(
                self._limits.backoff_s * 2.0 ** (self._failures - 2), self._limits.most_backoff_s
            )
            self._trouble += f"; the next attempt follows in {pause:g} s"
        self._not_before = now + pause

    def _give_up_start(self) -> None:
        if (
            self._first is not None
            and not self._first.done()
            and self._failures >= self._limits.attempts
        ):
            sentence = self._trouble.partition(";")[0]
            self._first.set_exception(
                EngineUnavailable(f"{sentence}, {self._failures} times in a row; see its messages")
            )

    def _hear(self, engine: EngineProcess, event: Event | None) -> None:
        if event is None or not engine.ready:
            self._wake.set()
        if event is not None and engine is self._active:
            self._publish(event)

    def _publish(self, event: Event) -> None:
        for callback in tuple(self._subscribers):
            try:
                callback(event)
            except Exception:  # noqa: BLE001
                # One listener's fault must neither deafen the others nor end the supervision.
                _log.exception("a listener failed at %s", type(event).__name__)

    # --- ending ----------------------------------------------------------------------------

    async def _end(self, engine: EngineProcess) -> None:
        """Let it leave by itself, then by SIGTERM, then by force."""
        try:
            await engine.request(Shutdown(), self._limits.stop_s)
        except (TimeoutError, EngineEnded):
            engine.terminate()
        if not await engine.wait_gone(self._limits.stop_s):
            engine.kill()
        await self._remove(engine)

    async def _remove(self, engine: EngineProcess) -> str:
        ending = await engine.remove()
        if not engine.reap():
            self._lingering.append(engine)
        return ending


_ENDED = "ended"


def _lost(engine: EngineProcess | None) -> int:
    if engine is None or engine.heartbeat is None:
        return 0
    return engine.heartbeat.counters.get("observations_lost", 0)
