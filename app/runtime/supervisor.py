"""Supervisor of one child process: starts it, listens to it, replaces it when it dies or hangs.

Optionally a second process stands by, started and idle, because on a busy machine a start can take
longer than the time within which a lost process must be replaced.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

from app.runtime.attempts import Attempts
from app.runtime.child import ChildEnded, ChildProcess
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.listeners import Listeners
from app.runtime.requests import Reply
from app.runtime.supervisor_limits import SupervisorLimits

_log = logging.getLogger(__name__)

_Command = TypeVar("_Command")
_Event = TypeVar("_Event")


@dataclass(frozen=True)
class ProcessHealth:
    """Health of a process.

    Attributes:
        generation: number of processes so far, including the present one.
        pid: None while there is none.
        alive: there is one, and it is supervised.
        restarts: number of replacements.
        heartbeat_age_s: time since the loop's last heartbeat; None while there is none.
        observations_lost: observations dropped because this process was slow to read them, over
            all its children.
    """

    generation: int
    pid: int | None
    alive: bool
    restarts: int
    heartbeat_age_s: float | None
    observations_lost: int


class ProcessSupervisor(Generic[_Command, _Event]):
    """Supervisor of the processes of one kind. Call all methods in the event loop's thread.

    A subclass defines its kind by the class attributes.

    Attributes:
        what: human-readable name of such a process.
        farewell: command that asks a process to shut down in order.
        heartbeat: type of event that proves that a process is alive; it has ``monotonic``.
        state: type of event whose newest instance is published when its process takes over.
        started, lost: types of event for a takeover and a loss, made from the generation and the
            process id, or from the generation and the reason.
    """

    what: ClassVar[str]
    farewell: ClassVar[Any]
    heartbeat: ClassVar[type[Any]]
    state: ClassVar[type[Any]]
    started: ClassVar[type[Any]]
    lost: ClassVar[type[Any]]

    def __init__(
        self, command: Sequence[str], slots: Mapping[str, int], limits: SupervisorLimits
    ) -> None:
        """Set up the supervisor.

        Args:
            command: command that starts a process; its arguments are appended.
            slots: descriptor of each latest-value slot by name, passed to every process.
        """
        self._command = tuple(command)
        self._limits = limits
        self._inherited = dict(slots)
        self._listeners: Listeners[_Event] = Listeners()
        self._active: ChildProcess | None = None
        # Started but not in service: the standby, or the next process while it starts.
        self._standby: ChildProcess | None = None
        # Killed, but not gone yet.
        self._lingering: list[ChildProcess] = []
        # Whether the last look at the processes failed.
        self._look_failed = False
        self._active_since = 0.0
        self._generation = 0
        self._lost_before = 0
        self._attempts = Attempts(limits)
        self._trouble = f"the {self.what} is starting"
        self._wake = asyncio.Event()
        self._first: asyncio.Future[None] | None = None
        self._watching: asyncio.Task[None] | None = None
        self._closed = False

    # --- for subclasses to override --------------------------------------------------------

    def _dropped(self, child: ChildProcess | None) -> int:
        """Return the number of messages from a process that were dropped."""
        del child
        return 0

    def _release(self) -> None:
        """Release the resources of the processes, after the last one has ended."""

    # --- public interface ------------------------------------------------------------------

    async def start(self) -> None:
        """Start the first process and wait until it is ready.

        Raises:
            ProcessUnavailable: all attempts failed; nothing is left running.
        """
        if self._watching is not None or self._closed:
            raise RuntimeError("a supervisor is started once")
        self._first = asyncio.get_running_loop().create_future()
        self._watching = asyncio.create_task(self._watch(), name=f"watch the {self.what}")
        try:
            await asyncio.shield(self._first)
        except BaseException:
            await self.stop()
            raise

    async def stop(self) -> None:
        """End every process and release all memory; safe to call twice."""
        if self._closed:
            return
        self._closed = True
        if self._watching is not None:
            # Do not cancel it: it may be starting or removing a process.
            self._wake.set()
            await asyncio.gather(self._watching, return_exceptions=True)
        children = [child for child in (self._active, self._standby) if child is not None]
        self._active = self._standby = None
        await asyncio.gather(*(self._end(child) for child in children))
        for child in self._lingering:
            if not await child.wait_gone(self._limits.stop_s):
                _log.error("%s process %d hangs inside the kernel", self.what, child.pid)
        self._release()

    async def request(
        self, command: _Command, timeout_s: float | None = None, *, repeatable: bool = False
    ) -> Any:
        """Send a request to the process and return its reply's value.

        Args:
            timeout_s: by default the limit ``answer_s``.
            repeatable: whether to send it again, to the next process, if this one ends before it
                answers, and to wait for the next one if there is none at the moment.

        Raises:
            ProcessRefused: the process refuses; the message says why.
            ProcessUnavailable: there is no process, or it ended or did not answer in time.
        """
        timeout_s = self._limits.answer_s if timeout_s is None else timeout_s
        child = await self._successor_of(None) if repeatable else self._active
        reply = await self._answer(child, command, timeout_s)
        if reply is None and repeatable:
            _log.warning("the %s ended; its request is sent to the next one", self.what)
            reply = await self._answer(await self._successor_of(child), command, timeout_s)
        what = _in_words(type(command).__name__)
        if reply is None:
            raise ProcessUnavailable(
                f"the {self.what} exited before it completed the request to {what}"
            )
        if reply.refusal is not None:
            raise ProcessRefused(reply.error or f"{what} was refused", reply.refusal)
        return reply.value

    async def _answer(
        self, child: ChildProcess | None, command: _Command, timeout_s: float
    ) -> Reply | None:
        """Return the reply of a process, None if it ended before it replied."""
        if self._closed:
            raise ProcessUnavailable("the server is shutting down")
        if child is None:
            raise ProcessUnavailable(self._trouble)
        try:
            return await child.request(command, timeout_s)
        except TimeoutError:
            what = _in_words(type(command).__name__)
            raise ProcessUnavailable(
                f"the {self.what} did not complete the request to {what} within {timeout_s:g} s"
            ) from None
        except ChildEnded:
            return None

    async def _successor_of(self, child: ChildProcess | None) -> ChildProcess | None:
        """Return the process in service other than ``child``; wait for one if there is none."""
        until = time.monotonic() + self._limits.takeover_s
        while (
            (self._active is None or self._active is child)
            and not self._closed
            and time.monotonic() < until
        ):
            await asyncio.sleep(self._limits.tick_s)
        return None if self._active is child else self._active

    def subscribe(self, callback: Callable[[_Event], None]) -> Callable[[], None]:
        """Call ``callback`` in the event loop for every event, in order.

        Returns:
            The function that ends the subscription.
        """
        return self._listeners.subscribe(callback)

    @property
    def health(self) -> ProcessHealth:
        child = self._active
        heartbeat = None if child is None else child.newest(self.heartbeat)
        return ProcessHealth(
            generation=self._generation,
            pid=None if child is None else child.pid,
            alive=child is not None and self._supervising,
            restarts=max(0, self._generation - 1),
            heartbeat_age_s=(
                None if heartbeat is None else max(0.0, time.monotonic() - heartbeat.monotonic)
            ),
            observations_lost=self._lost_before + self._dropped(child),
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
            # While this event loop was blocked, it could not receive anything: do not count that
            # time as the processes' silence.
            passed, looked = min(now - looked, 2 * self._limits.tick_s), now
            try:
                await self._look_after_all(passed)
            except Exception as error:  # noqa: BLE001
                # Whatever is wrong, the next look may find a dead or hung process.
                self._note_failed_look(error)
            else:
                self._look_failed = False

    async def _look_after_all(self, passed_s: float) -> None:
        for child in (self._active, self._standby):
            if child is not None:
                child.stay_silent(passed_s)
        self._lingering = [child for child in self._lingering if not child.reap()]
        await self._look_after_active()
        if not self._closed:
            await self._look_after_standby()

    def _note_failed_look(self, error: Exception) -> None:
        self._trouble = f"supervising the {self.what} failed: {error}"
        # Twenty times a second would flood the log.
        if not self._look_failed:
            _log.error("%s", self._trouble, exc_info=error)
        self._look_failed = True
        self._count_failure(time.monotonic())
        self._give_up_start()

    @property
    def _supervising(self) -> bool:
        watching = self._watching
        return watching is not None and not watching.done() and not self._look_failed

    async def _look_after_active(self) -> None:
        child = self._active
        if child is None:
            return
        complaint = self._complaint(child)
        if complaint is None:
            self._attempts.lives(self._active_since)
            return
        self._active = None
        self._lost_before += self._dropped(child)
        self._trouble = f"the {self.what} {complaint} and is being replaced"
        ending = await self._remove(child)
        reason = f"the {self.what} {ending if complaint == _ENDED else complaint}"
        _log.error("%s", reason)
        self._count_failure(self._active_since)
        self._listeners.publish(self.lost(self._generation, reason))

    async def _look_after_standby(self) -> None:
        now = time.monotonic()
        child = self._standby
        if child is None:
            if self._wants_another(now):
                await self._start_another()
            return
        complaint = self._complaint(child)
        if complaint is not None:
            self._standby = None
            ending = await self._remove(child)
            self._trouble = f"a starting {self.what} {ending if complaint == _ENDED else complaint}"
            _log.error("%s", self._trouble)
            self._count_failure(child.started)
            self._give_up_start()
        elif child.ready and self._active is None and now >= self._attempts.not_before:
            self._active, self._standby = child, None
            self._active_since = now
            self._generation += 1
            self._listeners.publish(self.started(self._generation, child.pid))
            state = child.newest(self.state)
            if state is not None:
                self._listeners.publish(state)
            if self._first is not None and not self._first.done():
                self._first.set_result(None)

    def _wants_another(self, now: float) -> bool:
        if now < self._attempts.not_before:
            return False
        if self._active is None:
            return True
        delay = self._limits.standby_delay_s
        return delay is not None and now >= self._active_since + delay

    async def _start_another(self) -> None:
        try:
            self._standby = await ChildProcess.start(
                self._command, self._inherited, self._hear, (self.heartbeat, self.state)
            )
        except Exception as error:  # noqa: BLE001
            # Whatever is wrong, try again later and less and less often.
            self._trouble = f"the {self.what} cannot be started: {error}"
            _log.error("%s", self._trouble, exc_info=not isinstance(error, OSError))
            self._count_failure(time.monotonic())
            self._give_up_start()

    def _complaint(self, child: ChildProcess) -> str | None:
        """Return the fault of a process as a phrase that follows its name; None if it is well."""
        if child.ended:
            return _ENDED
        limit = self._limits.hang_s if child.ready else self._limits.start_s
        if child.silent_s > limit or child.unheard_s > max(limit, self._limits.starved_s):
            return f"did not respond for {child.unheard_s:.1f} s"
        return None

    def _count_failure(self, since: float) -> None:
        pause = self._attempts.count_failure(since)
        if pause > 0.0:
            self._trouble += f"; the next attempt is in {pause:g} s"

    def _give_up_start(self) -> None:
        if self._first is not None and not self._first.done() and self._attempts.exhausted:
            sentence, times = self._trouble.partition(";")[0], self._attempts.failed
            self._first.set_exception(
                ProcessUnavailable(f"{sentence}, {times} times in a row; see its log")
            )

    def _hear(self, child: ChildProcess, event: _Event | None) -> None:
        if event is None or not child.ready:
            self._wake.set()
        if event is not None and child is self._active:
            self._listeners.publish(event)

    # --- ending ----------------------------------------------------------------------------

    async def _end(self, child: ChildProcess) -> None:
        """End a process: let it leave by itself, then SIGTERM, then force."""
        try:
            await child.request(self.farewell, self._limits.stop_s)
        except (TimeoutError, ChildEnded):
            child.terminate()
        if not await child.wait_gone(self._limits.stop_s):
            child.kill()
        await self._remove(child)

    async def _remove(self, child: ChildProcess) -> str:
        # Noted first, so that it is not forgotten if it cannot be ended.
        self._lingering.append(child)
        try:
            return await child.remove()
        except Exception as error:  # noqa: BLE001
            # Its loss must be published all the same.
            _log.exception("%s process %d cannot be ended", self.what, child.pid)
            return f"cannot be ended: {error}"


_ENDED = "ended"


def _in_words(name: str) -> str:
    """Return the name of a command's class, such as ``BeginCalibration``, in plain words."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
