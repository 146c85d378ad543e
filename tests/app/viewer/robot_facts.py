"""A robot that the guard slows, on its way to a goal."""

from __future__ import annotations

from app.contract.robots import (
    GoalNow,
    GuardVerdict,
    RobotNow,
    Velocity,
)
from observer.mount import CameraMount
from observer.navigation.plan import RefusedPath
from observer.robots.contract import RobotPhase, RobotReport, SonarReading

MOUNT = CameraMount(0.4, 0.3, 0.1, 0.06, pan_rad=0.2)
GUARD = GuardVerdict(
    level="slow",
    reason="obstacle 3 is 1.2 m ahead",
    limit_mps=0.1,
    stop_zone=[(0.5, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.5, -0.2)],
    slow_zone=[(1.5, 0.3), (-0.2, 0.3), (-0.2, -0.3)],
)
REPORT = RobotReport(
    RobotPhase.CONNECTED,
    width_m=0.4,
    length_m=0.6,
    received=10.0,
    sonars=(
        SonarReading(0, 0.1, 0.0, 0.0, 1.4, 9.9),
        SonarReading(1, 0.0, 0.1, 1.5, None, 9.9),
        SonarReading(1, 0.0, 0.1, 1.5, 0.8, 8.0),
    ),
)
GOAL = GoalNow(
    state="driving",
    sentence="Waiting for obstacle 3: it will cross in 1.4 s.",
    place=(3.0, -0.5),
    distance_m=3.04,
    elapsed_s=2.0,
    path=[(0.0, 0.0), (0.5, 0.1), (1.0, 0.1)],
    risk_per_metre=0.001,
    planned_risk_per_metre=0.0002,
    waits_for=3,
    meets_s=1.4,
    meets_at=(0.8, -0.2),
    refused=[
        RefusedPath(0.0, 0.5, ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0)), "risk", 0.04, 3, 1.2),
        RefusedPath(0.5, 0.5, tuple((0.1 * k, 0.05 * k) for k in range(9)), "guard"),
    ],
)
STILL = Velocity(0.0, 0.0)
ROBOT = RobotNow("port", "name", "real", "armed", None, False, None, STILL, STILL, GUARD, REPORT)
