"""Touch of the robot by sonar, on which a standing robot does not set off.

Somebody who has walked into the robot is out of view, and counts as no risk that driving adds: the
contact is there already. But a robot that sets off against a body pushes it or pulls it along, and
somebody who walks past is gone in a moment. What stays, such as a wall beside the robot, holds it
up only once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from observer.guard.outline import Outline
from observer.robots.contract import SonarReading

# An echo this near to the outline counts as touching it: sonars hardly measure anything nearer.
_TOUCH_M: Final = 0.1
# The robot waits this long after the last such echo, as the sonars of a ring are read in turn, and
# at most this long after the first.
_AFTER_S: Final = 0.5
_LONGEST_S: Final = 3.0


class Touch:
    """Echoes at the robot's outline, from plan to plan."""

    def __init__(self) -> None:
        self._first = self._last = -math.inf
        self._sonar = 0

    def hear(self, sonars: Sequence[SonarReading], outline: Outline) -> None:
        """Take in the newest readings, in the robot's base frame.

        Args:
            outline: of the robot.
        """
        for one in sorted(sonars, key=lambda each: each.received):
            if one.range_m is None or one.received <= self._last:
                continue
            x = one.x + one.range_m * math.cos(one.heading)
            y = one.y + one.range_m * math.sin(one.heading)
            if float(outline.distance(np.array(x), np.array(y))) <= _TOUCH_M:
                if one.received - self._last > _AFTER_S:
                    self._first = one.received
                self._last, self._sonar = one.received, one.index

    def sonar(self, now: float) -> int | None:
        """Return the number of the sonar that hears what the robot has to wait for, or None.

        Args:
            now: seconds, on the clock of the readings.
        """
        waits = now - self._last <= _AFTER_S and now - self._first <= _LONGEST_S
        return self._sonar if waits else None
