"""Touch of the robot by sonar, on which a standing robot does not set off.

Somebody who has walked into the robot is out of view, and adds no risk by driving: the contact is
there already. But a robot that sets off against a body pushes it or pulls it along, and somebody
who walks past is gone in a moment. What stays, such as a wall beside the robot, holds it up only
once, and hides nobody whom another sonar hears.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.guard.outline import Outline
from observer.robots.contract import SonarReading

# An echo this near to the outline counts as touching it: sonars hardly measure anything nearer.
_TOUCH_M: Final = 0.1
# The robot waits this long after the last such echo of a sonar, as the sonars of a ring are read in
# turn, and at most this long after the first.
_AFTER_S: Final = 0.5
_LONGEST_S: Final = 3.0
# A contact has ended once its sonar has heard nothing there for this long. Each sonar of a Pioneer
# is read every 0.32 s, so it may miss three echoes in a row.
_ENDED_S: Final = 1.5


@dataclass(frozen=True)
class _Contact:
    """First and last echo of one contact at one sonar, seconds on the clock of the readings."""

    first: float
    last: float


class Touch:
    """Echoes at the robot's outline, from plan to plan."""

    def __init__(self) -> None:
        # By the number of the sonar.
        self._contacts: dict[int, _Contact] = {}

    def hear(self, sonars: Sequence[SonarReading], outline: Outline) -> None:
        """Take in the newest readings, in the robot's base frame.

        Args:
            outline: of the robot.
        """
        for one in sonars:
            before = self._contacts.get(one.index)
            if one.range_m is None or (before is not None and one.received <= before.last):
                continue
            x = one.x + one.range_m * math.cos(one.heading)
            y = one.y + one.range_m * math.sin(one.heading)
            if float(outline.distance(np.array(x), np.array(y))) <= _TOUCH_M:
                first = one.received
                if before is not None and one.received - before.last <= _ENDED_S:
                    first = before.first
                self._contacts[one.index] = _Contact(first, one.received)

    def sonar(self, now: float) -> int | None:
        """Return the number of the sonar that hears what the robot has to wait for, or None.

        Of several, it is the one whose last echo is the newest.

        Args:
            now: seconds, on the clock of the readings.
        """
        waits = {
            number: one.last
            for number, one in self._contacts.items()
            if now - one.last <= _AFTER_S and now - one.first <= _LONGEST_S
        }
        return max(waits, key=waits.__getitem__, default=None)
