"""Drive loop: runs every 20 ms, whatever else happens.

Nothing in it blocks: requests come through a queue, replies and events leave by a bounded one,
robots and guard answer at once, and ports are opened and closed in threads of their own.
"""

from __future__ import annotations

import logging
import queue
import time
import traceback
from collections import deque
from collections.abc import Callable
from typing import Any

from app.contract.drive import (
    ArmRobot,
    DisarmRobot,
    DriveState,
    LeaveDrive,
    ReallySent,
    ResetStop,
    StartGoal,
    StartProgramme,
    WheelSpeedEvent,
)
from app.contract.robots import DriveLoopFacts
from app.drive import reasons
from app.drive.commands import Commands, DriveAnswer
from app.drive.facts import drive_facts, outline_of_facts, role_facts
from app.drive.jitter import Jitter, Lateness
from app.drive.priority import Priority, tidy
from app.drive.roles import Roles
from app.drive.stopping import StopWatch
from app.drive.wheels import Wheels
from app.runtime.errors import ProcessRefused
from app.runtime.requests import Reply, Request
from observer.errors import InputError
from observer.guard.sight import Sight
from observer.navigation.plan import Plan
from observer.rig.rig import ROLES, Role

_log = logging.getLogger(__name__)

TICK_S = 0.02
# Intervals in ticks: events, wheel odometry, lateness statistics.
_EVENT_TICKS = 5
_WHEELS_TICKS = 2
_LATENESS_TICKS = 50
# Time for releasing the robots at the end.
_GOODBYE_S = 2.5
_FAILED = "the drive process, which failed; see its log"
# A failure that repeats itself every tick is logged this often.
_LOG_AGAIN_S = 1.0
# What a failed tick undoes with its stop.
_UNDONE_BY_STOP = (ResetStop, StartGoal, StartProgramme)

Inbox = queue.SimpleQueue[Request | None]


class DriveLoop:
    """Drive loop; see the module. None in the inbox, or the end of the parent, ends the loop."""

    def __init__(
        self,
        *,
        roles: Roles,
        inbox: Inbox,
        send: Callable[[object], None],
        wheel_speeds_lost: Callable[[], int],
        newest_sight: Callable[[float], Sight | None],
        newest_plan: Callable[[float], Plan | None],
        write_wheels: Callable[[dict[str, Any]], object],
        orphaned: Callable[[], bool],
        priority: Priority,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Set up the loop.

        Args:
            roles: the loop waits for their robots' openers at the end.
            send: takes replies and events; returns at once.
            wheel_speeds_lost: returns how many events ``send`` has dropped.
            newest_sight, newest_plan: return the newest one at an instant, at once.
            write_wheels: takes the content of the slot ``WHEELS_NAME``.
            orphaned: returns true once the parent is gone.
            priority: the loop's, for the reports.
            clock: the host's monotonic clock.
        """
        self._roles = roles
        self._commands = Commands(roles)
        self._inbox = inbox
        self._send = send
        self._wheel_speeds_lost = wheel_speeds_lost
        self._newest_sight = newest_sight
        self._newest_plan = newest_plan
        self._write_wheels = write_wheels
        self._orphaned = orphaned
        self._priority = priority
        self._clock = clock
        self._jitter = Jitter()
        self._lateness = Lateness(None, None)
        self._wheels = Wheels()
        self._stop_watches = [StopWatch(role) for role in ROLES]
        self._reported: object = None
        self._tick_of_event = -_EVENT_TICKS
        # Requests taken in this tick and answered at its end.
        self._unanswered: deque[tuple[Request, Callable[[], object]]] = deque()
        # When each failure was last logged, by its type and place.
        self._logged: dict[tuple[type, str], float] = {}
        self.leaving = False

    def run(self) -> None:
        """Run until asked to stop; then stop and release all robots."""
        deadline = self._clock()
        while not self.leaving:
            deadline += TICK_S
            pause = deadline - self._clock()
            if pause > 0:
                time.sleep(pause)
            now = self._clock()
            late = max(0.0, now - deadline)
            # Missed ticks are not made up for.
            deadline += late // TICK_S * TICK_S
            self.tick(now, late)
            tidy(self._jitter.ticks)
        self._say_goodbye()

    def tick(self, now: float, late_s: float = 0.0) -> None:
        """Run one tick, this late. A failure stops all robots; the loop goes on to report it."""
        self._jitter.add(late_s)
        try:
            self._turn(now)
        except Exception as error:  # noqa: BLE001
            self._roles.stop(_FAILED, now)
            self._log_failure(error, now)
            self._answer_after_failure()

    def _log_failure(self, error: Exception, now: float) -> None:
        """Log a failure, unless the same one was logged within the last second."""
        *_, (frame, line) = traceback.walk_tb(error.__traceback__)
        key = (type(error), f"{frame.f_code.co_filename}:{line}")
        if now - self._logged.get(key, -_LOG_AGAIN_S) >= _LOG_AGAIN_S:
            self._logged[key] = now
            _log.error("a tick of the drive loop failed", exc_info=error)

    def _answer_after_failure(self) -> None:
        """Answer what was taken before the tick failed: its senders would wait in vain."""
        while self._unanswered:
            request, answer = self._unanswered.popleft()
            if isinstance(request.command, _UNDONE_BY_STOP):
                sentence = f"all robots were stopped by {_FAILED}"
                self._send(Reply(request.number, error=sentence, refusal="failure"))
                continue
            try:
                self._send(Reply(request.number, answer()))
            except Exception as error:  # noqa: BLE001
                self._send(_failed_reply(request, error))

    def _turn(self, now: float) -> None:
        self._take_requests(now)
        if self._orphaned():
            self.leaving = True
        if self.leaving:
            self._roles.stop("the drive process shutting down", now)
        self._roles.step(now, self._newest_sight(now), self._newest_plan(now))
        while self._unanswered:
            request, answer = self._unanswered[0]
            value = answer()
            self._unanswered.popleft()
            self._send(Reply(request.number, value))
        self._tell(now)

    # --- requests --------------------------------------------------------------------------

    def _take_requests(self, now: float) -> None:
        """Take all queued requests; those answered only after the tick are kept until then."""
        while True:
            try:
                request = self._inbox.get_nowait()
            except queue.Empty:
                return
            if request is None:
                self.leaving = True
                continue
            try:
                answer = self._take(request, now)
            except ProcessRefused as error:
                self._send(Reply(request.number, error=str(error), refusal=error.refusal))
            except InputError as error:
                self._send(Reply(request.number, error=str(error), refusal="input"))
            except Exception as error:
                self._send(_failed_reply(request, error))
                raise
            else:
                self._unanswered.append((request, answer))

    def _take(self, request: Request, now: float) -> Callable[[], object]:
        command = request.command
        if isinstance(command, LeaveDrive):
            self.leaving = True
            return lambda: None
        taken = self._commands.take(command, now)
        if isinstance(taken, DriveAnswer):
            role, age = taken.role, taken.age_s
            return lambda: self._really_sent(role, age)
        if isinstance(command, ArmRobot | DisarmRobot):
            role, driven = command.role, self._roles.driven[command.role]
            holder = self._roles.leases.holder(role)
            return lambda: role_facts(driven, holder)
        return lambda: taken

    def _really_sent(self, role: Role, age_s: float) -> ReallySent:
        driven, stopped = self._roles.driven[role], self._roles.stopped
        # A failed tick stops the robots after their hindrance was determined.
        why = driven.hindrance if stopped is None else reasons.stopped_by(stopped.by)
        return ReallySent(*driven.sent, why, age_s)

    # --- telling ---------------------------------------------------------------------------

    def _tell(self, now: float) -> None:
        incidents = self._roles.incidents()
        stops = [watch.update(now, self._roles, incidents) for watch in self._stop_watches]
        for event in (*incidents, *stops):
            if event is not None:
                self._send(event)
        ticks = self._jitter.ticks
        if ticks % _LATENESS_TICKS == 1:
            self._lateness = self._jitter.lateness()
        for role, driven in self._roles.driven.items():
            self._wheels.add(role, driven.report, now)
        if ticks % _WHEELS_TICKS == 0:
            errand = self._roles.errand()
            going = {} if errand is None else {"errand": errand.facts()}
            self._write_wheels(self._wheels.facts() | going)
        outline = outline_of_facts(self._roles)
        due = ticks - self._tick_of_event >= _EVENT_TICKS
        if due:
            self._tell_wheel_speeds(now)
        if due or outline != self._reported:
            if due:
                self._tick_of_event = ticks
            self._reported = outline
            self._send(DriveState(drive_facts(self._roles, now, self._loop_facts()), now))

    def _loop_facts(self) -> DriveLoopFacts:
        late, lost = self._lateness, self._wheel_speeds_lost()
        return DriveLoopFacts(self._jitter.ticks, late.p99_ms, late.max_ms, self._priority, lost)

    def _tell_wheel_speeds(self, now: float) -> None:
        for role, driven in self._roles.driven.items():
            report = driven.report
            if driven.armed and report is not None:
                time_of = now if report.received is None else report.received
                self._send(WheelSpeedEvent(role, time_of, driven.sent[0], report.speed_mps))

    # --- the end ---------------------------------------------------------------------------

    def _say_goodbye(self) -> None:
        """Release every robot, in parallel; the last tick has stopped them."""
        openers = self._roles.openers
        for role, driven in self._roles.driven.items():
            openers[role].close(driven.connect(None))
        until = self._clock() + _GOODBYE_S
        while any(each.busy for each in openers.values()) and self._clock() < until:
            time.sleep(TICK_S)
            for each in openers.values():
                # A robot still being opened is closed.
                each.opened()
            self._jitter.add(0.0)
            self._tell(self._clock())


def _failed_reply(request: Request, error: Exception) -> Reply:
    sentence = f"{type(request.command).__name__} failed: {error}"
    return Reply(request.number, error=sentence, refusal="failure")
