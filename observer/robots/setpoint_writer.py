"""The only thread that writes to a robot during a session: urgent commands, then velocities."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

from observer.robots.arcos import Command, command
from observer.robots.contract import SETPOINT_FRESH_S, Sent
from observer.robots.handshake import STANDSTILL
from observer.robots.packet_line import COMMAND_GAP_S
from observer.robots.serial_port import Port, PortLost

# Interval at which a velocity is resent: the firmware stops after silence, and a velocity that was
# corrupted on the line lasts no longer than this.
RESEND_S = 0.1
# On a slow line a rising velocity waits this long after the last one, so that the line is not
# busy when a zero is due: two commands take 19 ms at 9600 baud.
_SLOW_BAUD = 19200
_RISING_S = 0.04
# A process that has not written for this long was suspended, perhaps with the whole computer; the
# robot's watchdog has expired or is about to.
_FROZEN_S = 1.0

# Whole mm/s and deg/s, as sent.
Setpoint = tuple[int, int]
_ZERO: Setpoint = (0, 0)
_E_STOP = command(Command.E_STOP)


def since_boot() -> float:
    """Return a monotonic clock, seconds, that goes on while the computer is suspended (Linux)."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


class SetpointWriter:
    """Writes commands and velocities, each when it is due; no method waits for the port.

    Args:
        port: written to by nothing else. clock: of ``Sent.time`` and of freshness.
        since_boot: as ``since_boot``.

    Attributes:
        sent: the velocity that was sent last.
        broken: one sentence once the port is lost; nothing is written from then on.
        frozen: whether this process was suspended for ``_FROZEN_S`` or more; only zero is sent
            until the owner resets it.
    """

    def __init__(
        self,
        port: Port,
        clock: Callable[[], float],
        since_boot: Callable[[], float] = since_boot,
    ) -> None:
        self.sent: Sent | None = None
        self.broken: str | None = None
        self.frozen = False
        self._outage = False
        self._port = port
        self._clock = clock
        self._since_boot = since_boot
        self._rising_s = _RISING_S if (port.baud or math.inf) <= _SLOW_BAUD else 0.0
        self._changed = threading.Condition()
        self._commands: deque[bytes] = deque()
        # Unsent commands of the current velocity.
        self._pair: deque[bytes] = deque()
        # Whether that velocity is a standstill, which must be sent completely.
        self._whole = False
        self._asked, self._asked_at = _ZERO, -math.inf
        self._queued, self._queued_at = _ZERO, -math.inf
        # On the clock ``since_boot``.
        self._wrote_at = since_boot()
        self._finishing = False
        self._thread = threading.Thread(target=self._run, name="robot writer", daemon=True)
        self._thread.start()

    def drive(self, setpoint: Setpoint) -> None:
        """Send this velocity from now on, for ``SETPOINT_FRESH_S``."""
        with self._changed:
            self._asked_at = self._clock()
            if setpoint != self._asked:
                self._asked = setpoint
                self._changed.notify()

    def in_outage(self, outage: bool) -> None:
        """Note whether the robot may not hear us. Meanwhile only standstills that begin with STOP
        are sent, and one more before the first velocity afterwards."""
        with self._changed:
            if outage != self._outage:
                self._outage = outage
                self._tell(_ZERO, self._clock(), with_stop=True)
                self._changed.notify()

    def send(self, *commands: bytes) -> None:
        """Send these commands after the queued ones."""
        with self._changed:
            self._commands += commands
            self._changed.notify()

    def halt(self, *commands: bytes) -> None:
        """Send these first, then zero velocity; drop everything queued except E_STOP."""
        with self._changed:
            hard = _E_STOP in self._commands and _E_STOP not in commands
            self._commands = deque((_E_STOP, *commands) if hard else commands)
            self._pair.clear()
            self._asked, self._queued = _ZERO, _ZERO
            self._asked_at = self._queued_at = self._clock()
            self.sent = Sent(0.0, 0.0, self._clock())
            self._changed.notify()

    def finish(self, timeout_s: float) -> bool:
        """Write the queued commands and end; return whether it ended within the time."""
        with self._changed:
            self._finishing = True
            self._changed.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        failed: str | None = "its driver failed to write"
        try:
            while (each := self._next()) is not None:
                self._port.write(each)
                self._wrote_at = self._since_boot()
                time.sleep(COMMAND_GAP_S)
            failed = None
        except PortLost as error:
            failed = str(error)
        finally:
            self.broken = failed

    def _next(self) -> bytes | None:
        """Wait for the next command and return it; None at the end."""
        with self._changed:
            while True:
                if self._commands:
                    return self._commands.popleft()
                if self._finishing:
                    return None
                now = self._clock()
                wait = self._plan(now)
                if self._pair:
                    following = self._pair.popleft()
                    if not self._pair:
                        speed, turn_rate = self._queued
                        self.sent = Sent(speed / 1000, math.radians(turn_rate), now)
                    return following
                self._changed.wait(wait)

    def _plan(self, now: float) -> float:
        """Queue the velocity if it is due; return how long nothing will be due."""
        if self._pair and self._whole:
            # A robot that has received only half of a standstill may continue the other motion.
            return 0.0
        if self._since_boot() - self._wrote_at > _FROZEN_S:
            self.frozen = True
            self._asked_at = -math.inf
            self._tell(_ZERO, now, with_stop=True)
            return 0.0
        fresh = now - self._asked_at <= SETPOINT_FRESH_S and not (self._outage or self.frozen)
        target = self._asked if fresh else _ZERO
        resend = self._queued_at + RESEND_S
        if target != self._queued:
            rises = abs(target[0]) > abs(self._queued[0]) or abs(target[1]) > abs(self._queued[1])
            due = min(self._queued_at + self._rising_s, resend) if rises else now
        else:
            due = resend
        if due <= now:
            # The rest of the previous pair is outdated or identical.
            self._tell(target, now, with_stop=self._outage)
            return 0.0
        stale = self._asked_at + SETPOINT_FRESH_S if target != _ZERO else math.inf
        # Slightly longer, so that the time has certainly passed.
        return max(0.0, min(due, stale) - now) + 1e-4

    def _tell(self, setpoint: Setpoint, now: float, *, with_stop: bool) -> None:
        faster = abs(setpoint[0]) > abs(self._queued[0])
        self._queued, self._queued_at, self._whole = setpoint, now, with_stop
        if with_stop:
            self._pair = deque(STANDSTILL)
            return
        speed, turn = command(Command.VEL, setpoint[0]), command(Command.RVEL, setpoint[1])
        # Slow down before turning; set the new turn rate before the speed rises.
        self._pair = deque((turn, speed) if faster else (speed, turn))
