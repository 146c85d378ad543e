"""Consequences of a robot's status packets, or of their absence. Pure: time is an argument."""

from __future__ import annotations

import math
from collections import deque

from observer.robots.arcos import Command, command
from observer.robots.contract import REPORT_FRESH_S, BatteryLevel
from observer.robots.sip import RobotStatus

SILENCE_FAULT_S = 1.0
BATTERY_LOW_V = 11.75
BATTERY_CRITICAL_V = 11.0
# A status packet is up to 0.1 s old, and ENABLE takes a moment.
_SWITCHING_S = 0.3
# ENABLE is not acknowledged and may be lost: it is resent at these times after the request until
# the motors were seen on, and never after that.
_ENABLE_AGAIN_S = (0.3, 0.6)
_ENABLE_IN_VAIN_S = 1.5
_DISABLE_AGAIN_S = 0.5
# Share of the watchdog time: the robot counts from what it received, we from what we received.
_WATCHDOG_PART = 0.5
_AVERAGED = 30


class RobotWatch:
    """Latches faults, averages the battery voltage, and decides whether the robot may move.

    Times are seconds on a monotonic clock.

    Attributes:
        fault: one sentence from the first fault on until ``clear``.
        status: the newest packet of this connection; None before it, and once the connection is
            lost.
        received: when the newest packet came, on any connection.
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        self.status: RobotStatus | None = None
        self.received: float | None = None
        self._connected = False
        self._heard = -math.inf
        self._on_since: float | None = None
        self._off_since = -math.inf
        self._seen_on = False
        self._enables = 0
        self._disabled_again = -math.inf
        self._battery: deque[float] = deque(maxlen=_AVERAGED)

    @property
    def switched_on(self) -> bool:
        """Return whether its motors were switched on and not off again."""
        return self._on_since is not None

    @property
    def may_move(self) -> bool:
        """Return whether a velocity other than zero may be sent."""
        on = self.status is not None and self.status.motors_enabled
        return self._connected and self.fault is None and self.switched_on and on

    @property
    def battery_v(self) -> float | None:
        """Mean battery voltage over the last packets."""
        return sum(self._battery) / len(self._battery) if self._battery else None

    @property
    def battery(self) -> BatteryLevel | None:
        volts = self.battery_v
        if volts is None:
            return None
        # Rounded as it is shown: sums of tenths of a volt are not exact.
        volts = round(volts, 3)
        if volts < BATTERY_CRITICAL_V:
            return "critical"
        return "low" if volts < BATTERY_LOW_V else "good"

    def connected(self, now: float) -> None:
        """Begin a session, motors off."""
        self._connected = True
        self._heard = now
        self._battery.clear()
        self.switch_off(now)

    def lost(self, sentence: str, now: float) -> None:
        """Handle the loss of the session: a fault if there was a session."""
        if self._connected:
            self.blame(sentence)
        self._connected = False
        self.status = None
        self._battery.clear()
        self.switch_off(now)

    def closed(self) -> None:
        """Handle the intended end of the session."""
        self._connected = False
        self.status = None
        self._on_since = None

    def switch_on(self, now: float) -> bool:
        """Note that ENABLE 1 is sent; return False if a fault or a lost connection forbids it."""
        if self.fault is not None or not self._connected:
            return False
        self._on_since, self._seen_on, self._enables = now, False, 0
        return True

    def switch_off(self, now: float) -> None:
        """Note that ENABLE 0 is sent."""
        self._on_since = None
        self._off_since = now

    def saw(self, status: RobotStatus, now: float) -> bool:
        """Handle a status packet; return whether it caused a fault."""
        before = self.fault
        self.status, self.received, self._heard = status, now, now
        if status.battery_v is not None:
            self._battery.append(status.battery_v)
        self.blame(_cause(status))
        if self._on_since is not None:
            if status.motors_enabled:
                self._seen_on = True
            elif self._seen_on and now - self._on_since > _SWITCHING_S:
                self.blame("its motors switched off by themselves; check the robot, then arm it")
        return self.fault is not before

    def tick(self, now: float) -> bool:
        """Check the timeouts, every 0.1 s or more often; return whether that caused a fault."""
        before = self.fault
        if self._connected and now - self._heard >= SILENCE_FAULT_S:
            self.blame(_silence(SILENCE_FAULT_S))
        if (
            self._on_since is not None
            and not self._seen_on
            and now - self._on_since > _ENABLE_IN_VAIN_S
        ):
            self.blame("its motors did not switch on; check the robot's own switches")
        return self.fault is not before

    def silent(self, now: float) -> bool:
        """Return whether its status is overdue."""
        return self._connected and now - self._heard > REPORT_FRESH_S

    def in_outage(self, now: float, watchdog_s: float | None) -> bool:
        """Return whether its firmware may have stopped it, as it may not have heard us either.

        ``watchdog_s``: timeout of the firmware; None where unknown, 0 where it never stops.
        """
        bound = SILENCE_FAULT_S
        if watchdog_s:
            bound = min(bound, _WATCHDOG_PART * watchdog_s)
        return self._connected and now - self._heard >= bound

    def silence_s(self, now: float) -> float:
        """Seconds since its last status."""
        return now - self._heard

    def due_command(self, now: float) -> bytes | None:
        """Return ENABLE to send again if it seems to have been lost; else None."""
        if self._on_since is not None:
            late = (
                not self._seen_on
                and self._enables < len(_ENABLE_AGAIN_S)
                and now - self._on_since > _ENABLE_AGAIN_S[self._enables]
            )
            self._enables += late
            return command(Command.ENABLE, 1) if late and self.fault is None else None
        on = self.status is not None and self.status.motors_enabled
        if on and now - max(self._off_since, self._disabled_again) > _DISABLE_AGAIN_S:
            self._disabled_again = now
            return command(Command.ENABLE, 0)
        return None

    def clear(self, now: float) -> None:
        """Clear the fault unless its cause, or another, is present; motors off."""
        self.switch_off(now)
        if not self._connected:
            return
        self.fault = None
        if now - self._heard >= SILENCE_FAULT_S:
            self.blame(_silence(round(now - self._heard, 1)))
        if self.status is not None:
            self.blame(_cause(self.status))

    def warnings(self, now: float) -> tuple[str, ...]:
        """Return sentences worth knowing that do not forbid motion."""
        found = []
        if self.silent(now):
            found.append(f"its last status is {(now - self._heard) * 1000:.0f} ms old")
        if self.battery in ("low", "critical"):
            found.append(f"its battery is {self.battery}: {self.battery_v:.1f} V; charge it")
        status = self.status
        if status is not None:
            if (
                status.motors_enabled
                and not self.switched_on
                and now - self._off_since > _DISABLE_AGAIN_S
            ):
                found.append("its motors are on although it is not armed")
            if status.joystick:
                found.append("somebody is driving it with its own joystick")
            if status.sonar_overrun:
                found.append("its sonar readings cannot be read")
        return tuple(found)

    def blame(self, sentence: str | None) -> None:
        """Latch a fault; the first one stays. None is ignored."""
        if sentence is not None:
            self.fault = self.fault or sentence
            self._on_since = None
            self._off_since = max(self._off_since, self._heard)


def _cause(status: RobotStatus) -> str | None:
    """Return why a packet forbids motion; None if it does not."""
    left, right = status.stalled
    if left or right:
        which = "both wheels" if left and right else f"its {'left' if left else 'right'} wheel"
        return f"{which} stalled: something is blocking the robot"
    for end, bumpers in (("front", status.front_bumpers), ("rear", status.rear_bumpers)):
        if any(bumpers):
            return f"its {end} bumper {bumpers.index(True) + 1} is pressed"
    if status.stop_pressed:
        return "its own stop button is pressed"
    if status.e_stalled:
        return "its emergency stall input is active"
    return None


def _silence(seconds: float) -> str:
    return f"the robot sent no status for {seconds:g} s; check its cable or network"
