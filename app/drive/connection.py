"""What a role is connected to, and what all roles share at one tick."""

from __future__ import annotations

from dataclasses import dataclass

from observer.guard.parameters import GuardParameters
from observer.guard.sight import Sight
from observer.robots.contract import Robot


@dataclass(frozen=True)
class Connection:
    """A role's robot.

    Attributes:
        port: as people may see it, see ``observer.robot_opening.shown_port``.
        world, name: as asked for.
        robot: None until it is opened.
        trouble: one sentence of why it could not be, None while nothing is wrong.
    """

    port: str
    world: str
    name: str | None
    robot: Robot | None = None
    trouble: str | None = None


@dataclass(frozen=True)
class Tick:
    """What is the same for all roles at one tick.

    Attributes:
        now: the host's monotonic clock. dt: seconds since the tick before.
        sight: the newest.
        stopped: by whom, while the stop is latched.
    """

    now: float
    dt: float
    sight: Sight | None
    stopped: str | None
    parameters: GuardParameters
