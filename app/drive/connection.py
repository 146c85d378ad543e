"""Connection of a role, and the state all roles share at one tick."""

from __future__ import annotations

from dataclasses import dataclass

from observer.guard.parameters import GuardParameters
from observer.guard.sight import Sight
from observer.robots.contract import Robot


@dataclass(frozen=True)
class Connection:
    """Robot of a role.

    Attributes:
        port: in the form shown to people, see ``observer.robot_opening.shown_port``.
        world, name: as requested.
        robot: None until it is opened.
        trouble: one sentence on why it could not be opened; None while nothing is wrong.
    """

    port: str
    world: str
    name: str | None
    robot: Robot | None = None
    trouble: str | None = None


@dataclass(frozen=True)
class Tick:
    """Values that are the same for all roles at one tick.

    Attributes:
        now: the host's monotonic clock.
        dt: seconds since the previous tick.
        sight: the newest sight.
        stopped: who stopped the robots, while the stop is latched.
    """

    now: float
    dt: float
    sight: Sight | None
    stopped: str | None
    parameters: GuardParameters
