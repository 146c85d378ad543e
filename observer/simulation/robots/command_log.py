"""Log of the commands that arrive at a simulated robot, for tests and observers."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

# Several minutes of commands: a connected driver sends twenty per second.
_KEPT = 10_000


@dataclass(frozen=True)
class Arrived:
    """A command with a valid checksum.

    Attributes:
        time: the host's monotonic clock at its arrival.
        number: as in the protocol's table; SYNC packets count as 0, 1 and 2.
        argument: None where there is none.
        speed_mps, turn_rate_radps: setpoint from this command on. The firmware keeps it when its
            watchdog stops the robot.
        enabled: the motors are on after this command.
        unintended: it asks for a velocity that cannot be meant, see ``CommandLog``.
    """

    time: float
    number: int
    argument: int | bytes | None
    speed_mps: float
    turn_rate_radps: float
    enabled: bool
    unintended: bool

    @property
    def is_standstill(self) -> bool:
        """True if this command makes the robot stand still."""
        return not self.enabled or (self.speed_mps == 0.0 and self.turn_rate_radps == 0.0)


class CommandLog:
    """Commands in order of arrival; safe to use from any thread.

    Attributes:
        intended: decides whether a nonzero velocity (m/s, rad/s; one of them is 0 for VEL and
            RVEL) can be meant: anything within the robot's limits, unless a test sets tighter
            ones.
        count: number of commands so far.
        unintended: number of commands that asked for a velocity that cannot be meant.
        bad_bytes: number of bytes that belonged to no valid packet.
    """

    def __init__(self, intended: Callable[[float, float], bool]) -> None:
        self.intended = intended
        self.bad_bytes = 0
        self._lock = threading.Lock()
        self._arrived: deque[Arrived] = deque(maxlen=_KEPT)
        self.count = 0
        self.unintended = 0

    def add(self, command: Arrived) -> None:
        with self._lock:
            self._arrived.append(command)
            self.count += 1
            self.unintended += command.unintended

    def since(self, time: float = float("-inf")) -> list[Arrived]:
        """Return the commands that arrived at ``time`` or later, oldest first."""
        with self._lock:
            return [each for each in self._arrived if each.time >= time]

    def first_standing(self, time: float) -> Arrived | None:
        """Return the first command from ``time`` on that makes the robot stand still."""
        return next((each for each in self.since(time) if each.is_standstill), None)
