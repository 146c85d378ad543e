"""Static surroundings of the robot and its goal, as needed to choose a path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.navigation.local_map import LocalMap
from observer.navigation.rollouts import Motion, Rollouts
from observer.navigation.route import Route, route

# Distance at which the directions to drive in are compared.
_AHEAD_M: Final = 0.8
# A robot too close to a surface may lose this much clearance, so that it can leave.
_LEAVING_M: Final = 0.03


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Goal and surfaces around a robot, in one fixed frame.

    Attributes:
        goal: x, y metres. heading: direction to drive in now, radians.
        radius_m: of a circle that encloses the robot, margin included.
        clearance_m: from the robot's current place to the nearest surface.
    """

    goal: tuple[float, float]
    heading: float
    radius_m: float
    clearance_m: float
    _map: LocalMap
    _route: Route
    _time: float

    @staticmethod
    def of(
        local: LocalMap, goal: tuple[float, float], now: Motion, radius_m: float, time: float
    ) -> Surroundings:
        """Return the surroundings at an instant.

        Args:
            time: seconds, on the map's clock.
        """
        way = route(local, goal, radius_m, time)
        here = np.array([[now.x, now.y]])
        away = math.hypot(goal[0] - now.x, goal[1] - now.y)
        heading = way.heading(now.x, now.y, min(_AHEAD_M, away))
        clearance = float(local.clearance(here, time)[0])
        return Surroundings(goal, heading, radius_m, clearance, local, way, time)

    def left_m(self, now: Motion) -> float:
        """Return the straight distance from a robot to the goal, metres."""
        return math.hypot(self.goal[0] - now.x, self.goal[1] - now.y)

    def distance(self, places: Float64Array) -> Float64Array:
        """(...,) metres to drive from places (..., 2) to the goal."""
        return self._route.distance(places)

    def hits(self, ways: Rollouts) -> Float64Array:
        """(C, K) 1 where a path runs into a surface, else 0."""
        clearance = self._map.clearance(ways.poses[:, :, :2], self._time)
        least = min(self.radius_m, self.clearance_m - _LEAVING_M)
        return np.asarray(clearance < least, np.float64)
