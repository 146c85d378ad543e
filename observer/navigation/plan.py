"""Plan for the next seconds of an errand, and the reasons for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from pydantic import TypeAdapter

# Most rejected paths that a plan lists.
MOST_REFUSED: Final = 6


@dataclass(frozen=True)
class RefusedPath:
    """Path that the robot could have taken, and why it does not.

    Attributes:
        direction: from the robot's heading to the path's end, radians, positive to the left.
        speed_mps: highest speed on it.
        path: x, y of some places along it, metres.
        cause: ``risk`` where it would exceed the declared risk before the robot could have
            stopped, ``later`` where contact is likely after that, ``guard`` where the guard would
            not let it begin, ``surface`` where it runs into a static surface.
        risk: probability of a contact, per metre for ``risk`` and in total for ``later``; None for
            the others.
        track: number of the obstacle that would be met, negative while that is tentative.
        meets_s: seconds until that obstacle, or the surface, is met.
        guard: the guard's sentence.
    """

    direction: float
    speed_mps: float
    path: tuple[tuple[float, float], ...]
    cause: Literal["risk", "later", "guard", "surface"]
    risk: float | None = None
    track: int | None = None
    meets_s: float | None = None
    guard: str | None = None


@dataclass(frozen=True)
class Plan:
    """Velocity to drive now, the path that it begins, and why.

    Attributes:
        goal: number of the goal.
        received: the host's monotonic clock at the reception of the newest frame it is based on.
        speed_mps, turn_rate_radps: to ask of the robot now.
        path: x, y of the path of the next seconds, metres in the frame of the robot's odometry;
            empty where the robot is to stand.
        risk_per_metre: probability of touching somebody per metre until the robot could have
            stopped.
        reason: why the robot does what it does, one sentence.
        waits_for: number of the track for which it stands or turns aside, negative while that is
            tentative; None for none.
        meets_s: seconds until it would meet that track on the straight path; None for none.
        meets_at: x, y where that track is predicted to be then; None for none.
        refused: some paths that it does not take, in different directions, the best one first.
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
    meets_at: tuple[float, float] | None = None
    refused: tuple[RefusedPath, ...] = ()

    def facts(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


_PLAN = TypeAdapter(Plan)


def plan_of(facts: Mapping[str, Any]) -> Plan:
    """Return the plan with these ``facts``.

    Raises:
        ValueError: they do not describe a plan.
    """
    return _PLAN.validate_python(facts)
