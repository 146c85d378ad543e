"""Consequences of a network robot's messages, or of their absence. Pure: time is an argument."""

from __future__ import annotations

import math
from dataclasses import replace

from observer.robots.contract import (
    COUNTERS,
    SETPOINT_FRESH_S,
    RobotLimits,
    RobotPhase,
    RobotReport,
    Sent,
)
from observer.robots.models import RobotSpec
from observer.robots.network.messages import Hello, OdometryMessage, Permit
from observer.robots.odometry import is_jump
from observer.types import Odometry

# Time without odometry after which there is a fault.
SILENCE_S = 0.5
# Highest age of the newest confirmed permit; beyond it, the robot does not hear us. It allows for
# the time that a permit and its confirmation normally take.
UNHEARD_S = 0.7
# Time that a robot has to switch its motors on before there is a fault.
_ENABLE_WITHIN_S = 1.0
# More permits than are sent within ``UNHEARD_S``.
_MOST_UNCONFIRMED = 100
# Time by which a robot's messages may be out of order; a clock that goes back further was set.
_DISORDER_S = 0.02
# Factor by which a robot may exceed its limits, as when it is pushed.
_FASTER = 2.0
_ZERO = (0.0, 0.0)
# Fields of a report taken from the robot's hello, and from its newest odometry.
_OF_HELLO = ("name", "radius_m", "width_m", "length_m")
_OF_ODOMETRY = ("speed_mps", "turn_rate_radps", "battery_v")


class ExternalWatch:
    """Latches faults, keeps the setpoint, and decides what is permitted at an instant.

    Not thread-safe; its owner locks.

    Args:
        spec: of the model it is driven as, whose limits apply besides its own; None without one.
    """

    def __init__(self, spec: RobotSpec | None) -> None:
        self._spec = spec
        self.phase = RobotPhase.CONNECTING
        self.trouble: str | None = None
        self.sent: Sent | None = None
        self._hello: Hello | None = None
        self._said: OdometryMessage | None = None
        # By how much the times of the newest messages, which were ignored, went back at most.
        self._back_s = 0.0
        self._fault: str | None = None
        self._heard = self._confirmed = -math.inf
        self._enabled_at: float | None = None
        # Sequence of the permit that first allowed its motors to be on.
        self._enabled_by: int | None = None
        self._seen_enabled = False
        self._halted = False
        self._setpoint = _ZERO
        self._reason: str | None = None
        self._setpoint_at = -math.inf
        self._permit_times: dict[int, float] = {}
        self._place = _Place()
        self._delay = _Delay()
        self._counters = dict.fromkeys(COUNTERS, 0)

    # --- events of the connection ------------------------------------------------------------

    def connected(self, hello: Hello, now: float) -> None:
        """Handle the robot's hello; motors off, at zero velocity."""
        if self._hello is not None:
            self._counters["reconnects"] += 1
        self.phase, self.trouble = RobotPhase.CONNECTED, None
        self._hello, self._said, self._back_s = hello, None, 0.0
        self._heard = self._confirmed = now
        self._permit_times.clear()
        self._use_other_clock()
        self.disable()

    def said(self, message: OdometryMessage, now: float) -> None:
        """Handle odometry; old or repeated messages count as bad and change nothing.

        A clock that was set back makes all messages old until it has caught up. They count again
        then, or once that is a fault, and their delay is measured anew.
        """
        last = self._said
        if last is not None and (message.sequence <= last.sequence or message.time < last.time):
            self._counters["bad_packets"] += 1
            rises = message.sequence > last.sequence
            self._back_s = max(self._back_s, last.time - message.time) if rises else 0.0
            if not rises or not self.silent(now):
                return
            self._look(now)
            self._use_other_clock()
        elif self._back_s > _DISORDER_S:
            self._use_other_clock()
        self._back_s = 0.0
        self._counters["packets"] += 1
        self._said = message
        if self._hello is not None:
            self._place.move(message, self._hello.limits)
        # A delayed message arrives now but describes an earlier moment.
        self._heard = max(self._heard, now - self._delay.of(message.time, now))
        sent_at = self._permit_times.get(message.permit)
        if sent_at is not None:
            self._confirmed = max(self._confirmed, sent_at)
            for old in [each for each in self._permit_times if each < message.permit]:
                del self._permit_times[old]
        if message.fault is not None:
            self._fail(message.fault)
        # Only messages sent after it knew that its motors may be on count.
        if self._enabled_by is not None and message.permit >= self._enabled_by:
            self._seen_enabled = self._seen_enabled or message.enabled

    def bad(self) -> None:
        """Count an invalid message."""
        self._counters["bad_packets"] += 1

    def lost(self, sentence: str) -> None:
        """Handle the end of the connection; wait for another one."""
        if self.phase is RobotPhase.CONNECTED:
            self._fail(sentence)
        self.phase, self.trouble = RobotPhase.WAITING, sentence
        self._said = self.sent = None

    def failed(self) -> None:
        """Handle the failure of the listening thread."""
        self.lost("its driver failed")
        self.phase = RobotPhase.REFUSED

    def refused(self, sentence: str) -> None:
        """Handle the refusal of a connection."""
        if self.phase is not RobotPhase.CONNECTED:
            self.trouble = f"a robot was rejected: {sentence}"

    def closed(self) -> None:
        """Handle the end of listening."""
        self.disable()
        self.phase, self.trouble = RobotPhase.CLOSED, None

    def silent(self, now: float) -> bool:
        """Return whether its odometry is overdue, so that another connection may take its place."""
        return now - self._heard > SILENCE_S

    # --- requests of the drive loop ----------------------------------------------------------

    def enable(self, now: float) -> None:
        """Switch the motors on, unless it is not connected or has a fault."""
        if self.phase is RobotPhase.CONNECTED and self._fault is None:
            self._halted = False
            self._enabled_at, self._enabled_by = now, None
            self._seen_enabled = False
            self._setpoint, self._reason, self._setpoint_at = _ZERO, None, now

    def disable(self) -> None:
        """Command zero velocity and motors off."""
        self._enabled_at = self._enabled_by = None
        self._seen_enabled = self._halted = False
        self._setpoint, self._reason, self._setpoint_at = _ZERO, None, -math.inf

    def stop(self) -> None:
        """Do as ``disable``; the reason differs."""
        self.disable()
        self._halted = True

    def drive(self, speed_mps: float, turn_rate_radps: float, now: float) -> tuple[float, float]:
        """Take a velocity; return the permitted one."""
        limits = self.limits
        if not (math.isfinite(speed_mps) and math.isfinite(turn_rate_radps)) or limits is None:
            self._setpoint = _ZERO
        else:
            self._setpoint = (
                _within(speed_mps, limits.speed_mps),
                _within(turn_rate_radps, limits.turn_rate_radps),
            )
        self._setpoint_at = now
        permit = self.permit(now)
        return permit.speed_mps, permit.turn_rate_radps

    def explain(self, reason: str | None) -> bool:
        """Send this reason with each permit; return whether it differs from the one before."""
        changed = reason != self._reason
        self._reason = reason
        return changed

    def clear(self, now: float) -> None:
        """Clear the fault unless its cause persists."""
        if self._said is not None and self._said.fault is None and not self.silent(now):
            self._fault = None

    # --- consequences -------------------------------------------------------------------------

    def permit(self, now: float) -> Permit:
        """Return the permit at this instant."""
        if self.phase is RobotPhase.CONNECTED:
            self._look(now)
        if self._fault is not None:
            return Permit(*_ZERO, True, self._fault)
        if self._enabled_at is None:
            return Permit(*_ZERO, True, "stopped" if self._halted else "not armed")
        if now - self._setpoint_at > SETPOINT_FRESH_S:
            return Permit(*_ZERO, False, "no speed has been requested")
        if not self._seen_enabled:
            return Permit(*_ZERO, False, "its motors are not on yet")
        return Permit(*self._setpoint, False, self._reason)

    def permit_sent(self, permit: Permit, sequence: int, now: float) -> None:
        """Note that a permit went out."""
        if self._enabled_at is not None and self._enabled_by is None and not permit.stop:
            self._enabled_by = sequence
        self._permit_times[sequence] = now
        if len(self._permit_times) > _MOST_UNCONFIRMED:
            del self._permit_times[min(self._permit_times)]
        self.sent = Sent(permit.speed_mps, permit.turn_rate_radps, now)

    @property
    def limits(self) -> RobotLimits | None:
        """Limits of the robot, within those of the model it is driven as."""
        if self._hello is None:
            return None
        own, spec = self._hello.limits, self._spec
        if spec is None:
            return own
        return replace(
            own,
            speed_mps=min(own.speed_mps, spec.speed_max_mps),
            turn_rate_radps=min(own.turn_rate_radps, spec.turn_rate_max_radps),
        )

    def report(self, now: float, watchdog_s: float) -> RobotReport:
        """Return the robot's current state."""
        if self.phase is RobotPhase.CONNECTED:
            self._look(now)
        hello, said = self._hello, self._said
        return RobotReport(
            phase=self.phase,
            trouble=self.trouble,
            fault=self._fault,
            received=None if said is None else self._heard,
            model=None if self._spec is None else self._spec.model,
            odometry=self._place.odometry,
            motors_enabled=None if said is None else said.enabled,
            watchdog_s=watchdog_s,
            limits=self.limits,
            sent=self.sent,
            wanted=self._wanted,
            counters={**self._counters, "odometry_jumps": self._place.jumps},
            **{name: getattr(hello, name) for name in _OF_HELLO if hello},
            **{name: getattr(said, name) for name in _OF_ODOMETRY if said},
        )

    @property
    def _wanted(self) -> tuple[float, float] | None:
        """Speed and turn rate that a guarded robot would drive; None for a driven one."""
        if self._hello is None or self._hello.mode != "guarded" or self._said is None:
            return None
        return self._said.wanted or _ZERO

    def _look(self, now: float) -> None:
        if self.silent(now):
            self._fail(
                "the clock of its odometry went back; it must be monotonic"
                if self._back_s > _DISORDER_S
                else f"no odometry received for {SILENCE_S:g} s"
            )
        elif now - self._confirmed > UNHEARD_S:
            self._fail(f"it has not acknowledged a permit for {UNHEARD_S:g} s")
        elif self._enabled_at is None:
            return
        elif self._seen_enabled and self._said is not None and not self._said.enabled:
            self._fail("its motors switched off by themselves")
        elif not self._seen_enabled and now - self._enabled_at > _ENABLE_WITHIN_S:
            self._fail("its motors did not switch on")

    def _fail(self, sentence: str) -> None:
        # Keep the first reason; later ones are mostly its consequences.
        self._fault = self._fault or sentence
        self.disable()

    def _use_other_clock(self) -> None:
        self._place.begin_anew()
        self._delay = _Delay()


class _Place:
    """The robot's odometry, accumulated over its connections whatever origin each has.

    Attributes:
        jumps: how often its numbers jumped; a jump counts as standing still.
    """

    def __init__(self) -> None:
        self.odometry: Odometry | None = None
        self.jumps = 0
        self._last: OdometryMessage | None = None

    def begin_anew(self) -> None:
        self._last = None

    def move(self, message: OdometryMessage, limits: RobotLimits) -> None:
        last, here = self._last, self.odometry or Odometry(0.0, 0.0, 0.0)
        self._last = message
        if last is None:
            self.odometry = here
            return
        dx, dy = message.x - last.x, message.y - last.y
        turned = math.remainder(message.yaw - last.yaw, 2 * math.pi)
        if is_jump(
            math.hypot(dx, dy),
            turned,
            _FASTER * (message.time - last.time),
            speed_mps=limits.speed_mps,
            turn_rate_radps=limits.turn_rate_radps,
        ):
            self.jumps += 1
            return
        # From the robot's odometry frame to ours.
        turn = here.yaw - last.yaw
        c, s = math.cos(turn), math.sin(turn)
        self.odometry = Odometry(
            here.x + c * dx - s * dy,
            here.y + s * dx + c * dy,
            here.yaw + turned,
        )


class _Delay:
    """Transit delay of a message in excess of the lowest recent one."""

    # Long enough to contain a fast message, short enough that clock drift does not matter.
    _BUCKET_S = 10.0

    def __init__(self) -> None:
        self._least = self._least_before = math.inf
        self._bucket = -math.inf

    def of(self, time: float, now: float) -> float:
        """Return the delay in seconds, from the sender's clock and ours."""
        if now - self._bucket > self._BUCKET_S:
            self._least_before, self._least = self._least, math.inf
            self._bucket = now
        self._least = min(self._least, now - time)
        return now - time - min(self._least, self._least_before)


def _within(value: float, most: float) -> float:
    return max(-most, min(most, value))
