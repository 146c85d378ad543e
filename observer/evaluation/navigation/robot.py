"""Robot of the navigation benchmark: differential drive, limited accelerations, no slip."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from observer.evaluation.navigation.crowd import People
from observer.geometry import Float64Array, along_arc
from observer.guard.parameters import GuardParameters
from observer.navigation.errand import Errand, Goal
from observer.robots.contract import SonarReading
from observer.robots.models import RobotSpec, robot_spec

SPEC: Final[RobotSpec] = robot_spec("p3dx-sh")
# Where all of its outline moves more slowly than this, it stands.
_STATIONARY_MPS: Final = 0.02
_CORNER_M: Final = math.hypot(SPEC.length_m, SPEC.width_m) / 2


class Robot:
    """Robot that follows its commanded velocity as fast as its limits allow.

    Attributes:
        pose: (3,) x, y metres and yaw. speed_mps, turn_rate_radps: now.
    """

    def __init__(self, pose: tuple[float, float, float], limits: GuardParameters) -> None:
        self.pose = np.array(pose)
        self.speed_mps = self.turn_rate_radps = 0.0
        self._limits = limits

    @property
    def is_moving(self) -> bool:
        """Return whether it drives, or turns on the spot."""
        fastest = abs(self.speed_mps) + abs(self.turn_rate_radps) * _CORNER_M
        return fastest >= _STATIONARY_MPS

    def drive(self, speed_mps: float, turn_rate_radps: float, dt: float) -> None:
        """Drive for ``dt`` seconds, changing speed and turn rate towards these."""
        p = self._limits
        faster, slower = p.acceleration_mps2 * dt, p.deceleration_mps2 * dt
        self.speed_mps += float(np.clip(speed_mps - self.speed_mps, -slower, faster))
        most = p.turn_acceleration_radps2 * dt
        self.turn_rate_radps += float(np.clip(turn_rate_radps - self.turn_rate_radps, -most, most))
        x, y, yaw = self.pose.tolist()
        turned = self.turn_rate_radps * dt
        self.pose = np.array([*along_arc(x, y, yaw, self.speed_mps * dt, turned), yaw + turned])

    def errand(self, goal: Goal, sonars: tuple[SonarReading, ...], time: float) -> Errand:
        """Return what the robot reports on its way to a goal."""
        x, y, yaw = self.pose.tolist()
        return Errand(
            goal=goal,
            time=time,
            x=x,
            y=y,
            yaw=yaw,
            speed_mps=self.speed_mps,
            turn_rate_radps=self.turn_rate_radps,
            radius_m=SPEC.radius_m,
            width_m=SPEC.width_m,
            length_m=SPEC.length_m,
            sonars=sonars,
        )

    def touched(self, people: People) -> frozenset[int]:
        """Return the numbers of the people whose body reaches into the robot's outline."""
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        away: Float64Array = people.position - self.pose[:2]
        ahead = c * away[:, 0] + s * away[:, 1]
        aside = c * away[:, 1] - s * away[:, 0]
        gap = np.hypot(
            np.maximum(np.abs(ahead) - SPEC.length_m / 2, 0.0),
            np.maximum(np.abs(aside) - SPEC.width_m / 2, 0.0),
        )
        return frozenset(people.number[gap < people.radius_m].tolist())

    def drives_up_to(self, people: People) -> frozenset[int]:
        """Return the numbers of the people ahead of the robot in its direction of motion."""
        away = people.position - self.pose[:2]
        ahead = math.cos(self.pose[2]) * away[:, 0] + math.sin(self.pose[2]) * away[:, 1]
        before = math.copysign(1.0, self.speed_mps) * ahead > SPEC.length_m / 2
        return frozenset(people.number[before].tolist())
