"""A motion profile: timed velocities for each robot.

It knows nothing about consent or obstacles; its player handles them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from observer.errors import InputError
from observer.rig.rig import ROLES, Role

# Limits of the faster of the two robot models; each robot's own limits apply, too.
MAX_SPEED_MPS = 2.2
MAX_TURN_RATE_RADPS = math.radians(500)
# Limits for all steps of a role together; the first also for a single step.
MAX_SECONDS = 3600.0
MAX_STEPS = 1000
# A name becomes part of a file name and of a URL.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_MAX_TITLE, _MAX_HELP = 120, 2000


@dataclass(frozen=True)
class Step:
    """A velocity that is held, or ramped up to, for some time.

    Attributes:
        seconds: > 0, at most ``MAX_SECONDS``. speed_mps: forward, within ``MAX_SPEED_MPS``.
        turn_rate_radps: positive to the left, within ``MAX_TURN_RATE_RADPS``.
        ramp: the velocity changes linearly over the step from the previous one (from rest at the
            beginning), instead of at once.

    Raises:
        InputError: a number is not finite or out of bounds.
    """

    seconds: float
    speed_mps: float
    turn_rate_radps: float = 0.0
    ramp: bool = False

    def __post_init__(self) -> None:
        values = (self.seconds, self.speed_mps, self.turn_rate_radps)
        if not all(math.isfinite(value) for value in values) or self.seconds <= 0:
            raise InputError("a step needs finite numbers and a duration greater than 0 seconds")
        if self.seconds > MAX_SECONDS:
            raise InputError(
                f"a step may last at most {MAX_SECONDS:g} seconds, not {self.seconds:g}"
            )
        if abs(self.speed_mps) > MAX_SPEED_MPS:
            raise InputError(
                f"a step's speed must be within ±{MAX_SPEED_MPS} m/s, not {self.speed_mps:g}"
            )
        if abs(self.turn_rate_radps) > MAX_TURN_RATE_RADPS:
            raise InputError(
                f"a step's turn rate must be within ±{math.degrees(MAX_TURN_RATE_RADPS):g} degrees "
                f"per second, not {math.degrees(self.turn_rate_radps):g}"
            )


@dataclass(frozen=True)
class MotionProfile:
    """Timed velocities by role.

    Attributes:
        name: unique among profiles: letters, digits, - and _.
        title, help: for people; one line each, may be empty.
        steps: by role; a role without steps is not moved.
        gesture: start with the start-stop gesture (``observer.motion_profiles.gesture``).

    Raises:
        InputError: one sentence that names what is wrong.
    """

    name: str
    title: str
    help: str
    steps: Mapping[Role, tuple[Step, ...]]
    gesture: bool = False

    def __post_init__(self) -> None:
        if _NAME.fullmatch(self.name) is None:
            raise InputError(
                f"{self.name[:40]!r} is not a valid programme name; use up to 64 letters, digits, "
                "- and _"
            )
        for key, text, most in (("title", self.title, _MAX_TITLE), ("help", self.help, _MAX_HELP)):
            if len(text) > most or not text.isprintable() or text != text.strip():
                raise InputError(
                    f"the programme {self.name}: {key} must be one line of at most {most} "
                    f"printable characters"
                )
        if not any(self.steps.values()):
            raise InputError(f"the programme {self.name} moves no robot; add steps for a role")
        for role, steps in self.steps.items():
            if role not in ROLES:
                raise InputError(
                    f"the programme {self.name}: {str(role)[:40]!r} is not a role; the roles are "
                    f"{' and '.join(ROLES)}"
                )
            if len(steps) > MAX_STEPS or sum(step.seconds for step in steps) > MAX_SECONDS:
                raise InputError(
                    f"the programme {self.name}: the {role} may have at most {MAX_STEPS} steps "
                    f"lasting {MAX_SECONDS:g} seconds in total; repeat the programme instead"
                )

    @property
    def roles(self) -> tuple[Role, ...]:
        """The roles that it moves."""
        return tuple(role for role in ROLES if self.steps.get(role))
