"""What arrived at a simulated robot, and when: for tests, and for whoever watches one."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

# Minutes: a driver tells twenty commands a second, for as long as it is connected.
_KEPT = 10_000


@dataclass(frozen=True)
class Arrived:
    """A command with a right checksum.

    Attributes:
        time: the host's monotonic clock when it was taken.
        number: as in the protocol's table; SYNC packets count as 0, 1 and 2.
        argument: None where there is none.
        speed_mps, turn_rate_radps: the setpoint that holds from this command on. It is kept by
            a firmware that its watchdog stopped.
        enabled: whether the motors are on behind this command.
        unintended: it asks for a velocity that nobody can have meant, see ``CommandLog``.
    """

    time: float
    number: int
    argument: int | bytes | None
    speed_mps: float
    turn_rate_radps: float
    enabled: bool
    unintended: bool

    @property
    def stands(self) -> bool:
        """Whether the robot is to stand still behind this command."""
        return not self.enabled or (self.speed_mps == 0.0 and self.turn_rate_radps == 0.0)


class CommandLog:
    """Commands in the order they arrived; safe to use from any thread.

    Attributes:
        intended: decides of a velocity other than zero (m/s, rad/s; one of them is 0 for VEL and
            RVEL) whether somebody meant it; everything within the robot's limits, unless a test
            knows better and sets it.
        bad_bytes: bytes that belonged to no valid packet.
    """

    def __init__(self, intended: Callable[[float, float], bool]) -> None:
        self.intended = intended
        self.bad_bytes = 0
        self._lock = threading.Lock()
        self._arrived: deque[Arrived] = deque(maxlen=_KEPT)
        self._count = 0
        self._unintended = 0

    @property
    def count(self) -> int:
        """Commands so far."""
        return self._count

    @property
    def unintended(self) -> int:
        """How many commands asked for a velocity that nobody meant."""
        return self._unintended

    def add(self, command: Arrived) -> None:
        with self._lock:
            self._arrived.append(command)
            self._count += 1
            self._unintended += command.unintended

    def clear(self) -> None:
        """Forget the commands; the counts stay."""
        with self._lock:
            self._arrived.clear()

    def since(self, time: float = float("-inf")) -> list[Arrived]:
        """Those that arrived at ``time`` or later, the oldest first."""
        with self._lock:
            return [each for each in self._arrived if each.time >= time]

    def first_standing(self, time: float) -> Arrived | None:
        """The first command from ``time`` on behind which the robot is to stand still."""
        return next((each for each in self.since(time) if each.stands), None)
