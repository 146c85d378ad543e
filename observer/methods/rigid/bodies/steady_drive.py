"""Tells that an apparent body with limbs drives: points on it move steadily, but limbs swing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from observer.geometry import Float64Array

# A group of fewer points may be a foot.
_LEAST_POINTS = 8
# Seconds for which it must move steadily, and for which it may be out of sight meanwhile.
_STEADY_S, _GAP_S = 0.5, 0.4
# Velocities that differ by less than so many m/s plus this share are alike; gain of their mean.
_ALIKE_MPS, _ALIKE_SHARE = 0.03, 0.15
_GAIN = 0.2


@dataclass(eq=False)
class SteadyDrive:
    """For how long a group of points on a body has moved as one.

    Attributes:
        velocity: (3,) m/s, world. since_s, until_s: ages of the body, seconds.
    """

    velocity: Float64Array = field(default_factory=lambda: np.zeros(3))
    since_s: float = 0.0
    until_s: float = -np.inf

    def note(self, velocity: Float64Array, points: int, age_s: float) -> bool:
        """Note a group's velocity (3,) m/s; returns whether it has moved so for long enough."""
        change = float(np.linalg.norm(velocity - self.velocity))
        like_before = change < _ALIKE_MPS + _ALIKE_SHARE * float(np.linalg.norm(velocity))
        goes_on = like_before and age_s - self.until_s <= _GAP_S
        if not goes_on:
            if points < _LEAST_POINTS:
                return False
            self.velocity, self.since_s = velocity, age_s
        self.velocity = self.velocity + _GAIN * (velocity - self.velocity)
        self.until_s = age_s
        return points >= _LEAST_POINTS and age_s - self.since_s >= _STEADY_S
