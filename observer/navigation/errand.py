"""Goal of a robot and the robot's state, as input to the planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from pydantic import TypeAdapter

from observer.robots.contract import SonarReading

# A goal is reached within this distance.
REACHED_M: Final = 0.25


@dataclass(frozen=True)
class Goal:
    """Place on the floor to which a robot is sent.

    Attributes:
        number: increases with every goal.
        x, y: metres in the frame of the robot's odometry.
        risk_per_metre: declared probability of touching somebody on each metre driven.
    """

    number: int
    x: float
    y: float
    risk_per_metre: float


@dataclass(frozen=True)
class Errand:
    """A goal, and the robot on its way there.

    Attributes:
        time: of the robot's report, host's monotonic clock.
        x, y, yaw: its odometry, metres and radians.
        speed_mps, turn_rate_radps: by its encoders, or as commanded where it reports none.
        radius_m, width_m, length_m: its outline; None where unknown.
        sonars: newest readings.
    """

    goal: Goal
    time: float
    x: float
    y: float
    yaw: float
    speed_mps: float
    turn_rate_radps: float
    radius_m: float | None
    width_m: float | None
    length_m: float | None
    sonars: tuple[SonarReading, ...] = ()

    def facts(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


_ERRAND = TypeAdapter(Errand)


def errand_of(facts: Mapping[str, Any]) -> Errand:
    """Return the errand with these ``facts``.

    Raises:
        ValueError: they do not describe an errand.
    """
    return _ERRAND.validate_python(facts)
