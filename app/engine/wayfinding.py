"""Plan of the observer's way to its goal, made of each frame and told to the drive process.

What it goes by, the local map, is shown and recorded now and then.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np

from app.engine.wheel_feed import WheelFeed
from app.runtime.latest import LatestWriter
from observer.guard.sight import Sight
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import AllParameters
from observer.occupancy import OccupancyMap

# So often for people to see; it grows slowly.
_MAP_EVERY_S = 0.5
_log = logging.getLogger(__name__)


class Wayfinder:
    """Planner of the observer's way: idle until the robot is sent somewhere."""

    def __init__(self, plan: LatestWriter, wheels: WheelFeed, clock: Callable[[], float]) -> None:
        """Set the slots.

        Args:
            plan: the slot ``PLAN_NAME``.
            wheels: tells the errand and where the robot was.
            clock: the host's monotonic clock.
        """
        self._plan = plan
        self._wheels = wheels
        self._clock = clock
        self._navigator: Navigator | None = None
        self._failed = False
        self._map_due = -math.inf

    def look(self, sight: Sight, parameters: AllParameters) -> OccupancyMap | None:
        """Plan by a frame; without a plan the drive process lets the robot stand.

        Return the local map if it is time for one.

        Args:
            parameters: those in force.
        """
        guard, planner = parameters.guard, parameters.navigation
        now = self._clock()
        errand = self._wheels.errand(now)
        if errand is None:
            # What it knows of the surroundings is of no use later.
            self._navigator = None
            return None
        place = self._wheels.odometry(sight.received)
        if place is None:
            return None
        try:
            if self._navigator is None:
                self._navigator = Navigator(guard, planner)
            self._navigator.use(guard, planner)
            self._navigator.see(sight, np.array([place.x, place.y, place.yaw]))
            plan = self._navigator.plan(errand, now)
        except Exception:  # noqa: BLE001
            # The robot stands without a plan; observing continues.
            if not self._failed:
                _log.exception("planning the way to the goal failed")
            self._failed = True
            return None
        self._failed = False
        self._plan.write(plan.facts())
        return self._local_map(self._navigator, sight.received)

    def _local_map(self, navigator: Navigator, received: float) -> OccupancyMap | None:
        if received < self._map_due:
            return None
        made = navigator.local_map()
        if made is not None:
            self._map_due = received + _MAP_EVERY_S
        return made
