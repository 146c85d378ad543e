"""Drive of the observer to a goal: which plan it follows, and how far it has come.

The plans come from the engine; the guard still limits whatever they ask for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from app.contract.drive import PLAN_FRESH_S
from app.contract.robots import GoalNow, GoalState
from app.drive.consent import ZERO, Velocity
from observer.navigation.errand import REACHED_M, Errand, Goal
from observer.navigation.plan import Plan
from observer.robots.contract import RobotReport
from observer.types import Odometry

_NO_PLAN: Final = "Waiting for a plan of the path."


@dataclass(frozen=True)
class _End:
    state: GoalState
    sentence: str
    time: float


class Going:
    """Drive to one goal, kept after its end. It reads no clock: the caller passes the time.

    Attributes:
        goal: in the frame of the robot's odometry.
        hindrance: why the robot stands although a plan asks for more, one sentence.
    """

    def __init__(self, goal: Goal, began: float) -> None:
        self.goal = goal
        self.hindrance: str | None = None
        self._began = began
        self._plan: Plan | None = None
        self._here: Odometry | None = None
        self._end: _End | None = None

    @property
    def over(self) -> bool:
        """Return whether it ended, at the goal or before."""
        return self._end is not None

    @property
    def reached(self) -> bool:
        """Return whether the robot is at the goal."""
        here = self._here
        return here is not None and self._distance(here) <= REACHED_M

    def update(self, report: RobotReport | None, plan: Plan | None, now: float) -> None:
        """Take over the robot's position, and the newest plan if it is for this goal."""
        self._here = None if report is None else report.odometry
        good = plan is not None and plan.goal == self.goal.number and _finite(plan)
        fresh = good and plan is not None and now - plan.received <= PLAN_FRESH_S
        self._plan = plan if fresh else None

    @property
    def velocity(self) -> Velocity:
        """Return the velocity to ask for; zero without a fresh plan."""
        plan = self._plan
        return ZERO if plan is None else (plan.speed_mps, plan.turn_rate_radps)

    def end(self, state: GoalState, sentence: str, now: float) -> None:
        """Note its end."""
        self._end = _End(state, sentence, now)
        self._plan = None

    def errand(self, report: RobotReport, sent: Velocity) -> Errand | None:
        """Return what a planner needs; None if the robot's position is unknown.

        Args:
            sent: velocity really sent last.
        """
        here = report.odometry
        if self.over or here is None or report.received is None:
            return None
        speed, turn = report.speed_mps, report.turn_rate_radps
        return Errand(
            goal=self.goal,
            time=report.received,
            x=here.x,
            y=here.y,
            yaw=here.yaw,
            speed_mps=sent[0] if speed is None else speed,
            turn_rate_radps=sent[1] if turn is None else turn,
            radius_m=report.radius_m,
            width_m=report.width_m,
            length_m=report.length_m,
            sonars=report.sonars,
        )

    def facts(self, now: float) -> GoalNow:
        """Return the facts as ``DriveState.facts`` holds them."""
        here, plan, end = self._here, self._plan, self._end
        place = None if here is None else _seen_from(here, [(self.goal.x, self.goal.y)])[0]
        seen = None if here is None or plan is None else _plan_from(here, plan)
        return GoalNow(
            state="driving" if end is None else end.state,
            sentence=self._sentence(),
            place=place,
            distance_m=None if here is None else self._distance(here),
            elapsed_s=(now if end is None else end.time) - self._began,
            path=() if seen is None else seen.path,
            risk_per_metre=self.goal.risk_per_metre,
            planned_risk_per_metre=None if plan is None else plan.risk_per_metre,
            waits_for=None if plan is None else plan.waits_for,
            meets_s=None if plan is None else plan.meets_s,
            meets_at=None if seen is None else seen.meets_at,
            refused=() if seen is None else seen.refused,
        )

    def _sentence(self) -> str:
        if self._end is not None:
            return self._end.sentence
        if self.hindrance is not None:
            return f"Waiting: {self.hindrance}."
        return _NO_PLAN if self._plan is None else self._plan.reason

    def _distance(self, here: Odometry) -> float:
        return math.hypot(self.goal.x - here.x, self.goal.y - here.y)


def place_ahead(here: Odometry, ahead_m: float, left_m: float) -> tuple[float, float]:
    """Return a place relative to the robot in the frame of its odometry, metres."""
    c, s = math.cos(here.yaw), math.sin(here.yaw)
    return here.x + c * ahead_m - s * left_m, here.y + s * ahead_m + c * left_m


def _plan_from(here: Odometry, plan: Plan) -> Plan:
    """Return the plan with its places relative to the robot."""
    meets_at = None if plan.meets_at is None else _seen_from(here, [plan.meets_at])[0]
    refused = tuple(replace(one, path=_seen_from(here, one.path)) for one in plan.refused)
    return replace(plan, path=_seen_from(here, plan.path), meets_at=meets_at, refused=refused)


def _seen_from(
    here: Odometry, places: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return places as metres ahead and to the left, to the millimetre."""
    c, s = math.cos(here.yaw), math.sin(here.yaw)
    away = [(x - here.x, y - here.y) for x, y in places]
    return tuple((round(c * x + s * y, 3), round(c * y - s * x, 3)) for x, y in away)


def _finite(plan: Plan) -> bool:
    numbers = (plan.received, plan.speed_mps, plan.turn_rate_radps)
    return all(math.isfinite(number) for number in numbers)
