"""Wheel odometry of the robots, kept for the engine."""

from __future__ import annotations

from collections import deque

from observer.rig.rig import ROLES, Role
from observer.robots.contract import RobotPhase, RobotReport

KEPT_S = 1.0


class Wheels:
    """Odometry of each robot over the last second."""

    def __init__(self) -> None:
        self._driven: dict[Role, deque[list[float]]] = {role: deque() for role in ROLES}

    def add(self, role: Role, report: RobotReport | None, now: float) -> None:
        """Add the report of this tick; a robot that is gone has no odometry."""
        driven = self._driven[role]
        if report is None or report.phase is not RobotPhase.CONNECTED:
            driven.clear()
            return
        odometry, received = report.odometry, report.received
        if odometry is None or received is None:
            return
        if not driven or received > driven[-1][0]:
            driven.append([received, odometry.x, odometry.y, odometry.yaw])
        while driven and now - driven[0][0] > KEPT_S:
            driven.popleft()

    def facts(self) -> dict[str, list[list[float]]]:
        """Return the odometry as the slot ``WHEELS_NAME`` holds it."""
        return {role: list(driven) for role, driven in self._driven.items()}
