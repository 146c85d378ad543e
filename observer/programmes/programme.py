"""A programme: which robot shall drive how fast, and when.

A programme says nothing of who consents or what is in the way; whoever plays it does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from observer.errors import InputError
from observer.rig.rig import ROLES, Role


@dataclass(frozen=True)
class Step:
    """A velocity that holds for some time; both robots of a programme may have other steps.

    Attributes:
        seconds: > 0. speed_mps: forward. turn_rate_radps: positive to the left.
        ramp: whether the velocity is reached evenly over the step from the one before (from rest
            at the beginning), instead of at once.
    """

    seconds: float
    speed_mps: float
    turn_rate_radps: float = 0.0
    ramp: bool = False

    def __post_init__(self) -> None:
        values = (self.seconds, self.speed_mps, self.turn_rate_radps)
        if not all(math.isfinite(value) for value in values) or self.seconds <= 0:
            raise InputError("a step needs finite numbers and a duration above 0 seconds")


@dataclass(frozen=True)
class Programme:
    """Steps by role.

    Attributes:
        name: short, unique among programmes. title, help: for people.
        steps: by role; a role without steps is not moved.
        gesture: whether it begins with the start-stop gesture by which clocks are aligned later.
    """

    name: str
    title: str
    help: str
    steps: Mapping[Role, tuple[Step, ...]]
    gesture: bool = False

    def __post_init__(self) -> None:
        if not any(self.steps.values()):
            raise InputError(f"the programme {self.name} moves no robot; give steps for a role")
        for role in self.steps:
            if role not in ROLES:
                raise InputError(
                    f"the programme {self.name}: {str(role)[:40]!r} is no role; "
                    f"the roles are {' and '.join(ROLES)}"
                )

    @property
    def roles(self) -> tuple[Role, ...]:
        """Those it moves."""
        return tuple(role for role in ROLES if self.steps.get(role))
