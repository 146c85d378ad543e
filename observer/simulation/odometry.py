"""Simulated wheel odometry of the observer, with the errors of real wheels."""

from __future__ import annotations

import math

import numpy as np

from observer.simulation.robots.vehicle import SCALE_SIGMA, TURN_SIGMA
from observer.simulation.world import World
from observer.types import Odometry

# Standard deviations per frame: encoders in metres and radians, slip in radians per metre.
_DISTANCE_SIGMA_M = 0.0003
_YAW_SIGMA = 0.0003
_SLIP_RADPM = 0.01


class SimulatedOdometry:
    """Odometry of one run, from its first frame on; equal seeds give equal numbers.

    Distances are scaled by a factor that is constant over the run, as with a worn tyre; the yaw
    drifts in proportion to every turn and by slip.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._rng = np.random.default_rng(np.random.SeedSequence([world.seed, 0x0D0]))
        self._scale = 1 + SCALE_SIGMA * float(self._rng.standard_normal())
        self._turn = 1 + TURN_SIGMA * float(self._rng.standard_normal())
        self._time: float | None = None
        self._x = self._y = self._yaw = 0.0

    def read(self, time: float) -> Odometry:
        """Return the odometry at ``time``, seconds, which must not decrease."""
        if self._time is not None and time > self._time:
            self._drive(self._time, time)
        self._time = time
        return Odometry(self._x, self._y, self._yaw)

    def _drive(self, before: float, now: float) -> None:
        motion = self._world.observer.motion
        a, b = motion.state(before), motion.state(now)
        c, s = math.cos(a.heading), math.sin(a.heading)
        dx, dy = b.x - a.x, b.y - a.y
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        turned = math.remainder(b.heading - a.heading, 2 * math.pi)
        along, yaw, slip = self._rng.standard_normal(3)
        moves = math.hypot(dx, dy) > 0 or turned != 0
        noise = self._scale + (
            _DISTANCE_SIGMA_M * along / max(abs(ahead), _DISTANCE_SIGMA_M) if moves else 0
        )
        ahead, aside = ahead * noise, aside * self._scale
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        self._x += c * ahead - s * aside
        self._y += s * ahead + c * aside
        self._yaw += self._turn * turned
        if moves:
            self._yaw += _YAW_SIGMA * yaw + _SLIP_RADPM * slip * abs(ahead)
