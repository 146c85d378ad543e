"""Plans the observer's path to its goal at each frame and sends it to the drive process.

The local map it plans on is shown and recorded at intervals.
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

# Interval of the maps for display, which change slowly.
_MAP_EVERY_S = 0.5
_log = logging.getLogger(__name__)


class Wayfinder:
    """Planner of the observer's path: idle until the robot is sent somewhere."""

    def __init__(self, plan: LatestWriter, wheels: WheelFeed, clock: Callable[[], float]) -> None:
        """Set the slots.

        Args:
            plan: the slot ``PLAN_NAME``.
            wheels: gives the errand and the robot's odometry.
            clock: the host's monotonic clock.
        """
        self._plan = plan
        self._wheels = wheels
        self._clock = clock
        self._navigator: Navigator | None = None
        self._failed = False
        self._map_due = -math.inf

    def plan(self, sight: Sight, parameters: AllParameters) -> OccupancyMap | None:
        """Plan from a frame; without a plan the drive process keeps the robot stopped.

        Return the local map if one is due.

        Args:
            parameters: the current parameters.
        """
        guard, planner = parameters.guard, parameters.navigation
        now = self._clock()
        errand = self._wheels.errand(now)
        if errand is None:
            # Discard its map: it will be outdated by the next errand.
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
            self._plan.write(self._navigator.plan(errand, now).facts())
            local_map = self._local_map(self._navigator, sight.received)
        except Exception:  # noqa: BLE001
            # Without a plan the robot stays stopped; observing continues.
            if not self._failed:
                _log.exception("planning the way to the goal failed")
            self._failed = True
            return None
        self._failed = False
        return local_map

    def _local_map(self, navigator: Navigator, received: float) -> OccupancyMap | None:
        if received < self._map_due:
            return None
        made = navigator.local_map()
        if made is not None:
            self._map_due = received + _MAP_EVERY_S
        return made
