"""Plan of the next seconds of an errand, and the reasons for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import TypeAdapter


@dataclass(frozen=True)
class Plan:
    """Velocity to drive now, the path that it begins, and why.

    Attributes:
        goal: number of the goal.
        received: the host's monotonic clock at the reception of the newest frame it goes by.
        speed_mps, turn_rate_radps: to ask of the robot now.
        path: x, y of the path of the next seconds, metres in the frame of the robot's odometry;
            empty where the robot is to stand.
        risk_per_metre: probability of touching somebody on each metre until the robot could stand
            again.
        reason: why the robot does what it does, one sentence.
        waits_for: number of the track for which it stands or turns aside, below zero while that is
            tentative; None for none.
        meets_s: seconds until it would meet that one on the straight path; None for none.
    """

    goal: int
    received: float
    speed_mps: float
    turn_rate_radps: float
    path: tuple[tuple[float, float], ...]
    risk_per_metre: float
    reason: str
    waits_for: int | None = None
    meets_s: float | None = None

    def facts(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


_PLAN = TypeAdapter(Plan)


def plan_of(facts: Mapping[str, Any]) -> Plan:
    """Return the plan of which these are the ``facts``.

    Raises:
        ValueError: they are of none.
    """
    return _PLAN.validate_python(facts)
