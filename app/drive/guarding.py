"""Interface between the drive process and the guard of its robots."""

from __future__ import annotations

from typing import Protocol

from app.drive.consent import Velocity
from observer.guard.guard import Verdict
from observer.guard.parameters import GuardParameters
from observer.guard.sight import Sight
from observer.rig.rig import Role
from observer.robots.contract import SonarReading


class Guarding(Protocol):
    """Interface of a guard; ``observer.guard.guard.Guard`` implements it."""

    def use(self, parameters: GuardParameters) -> None: ...

    def forget(self, role: Role) -> None: ...

    def limit(
        self,
        role: Role,
        wanted: Velocity,
        measured: tuple[float | None, float | None],
        sight: Sight | None,
        world: str,
        sonars: tuple[SonarReading, ...],
        radius_m: float | None,
        width_m: float | None,
        length_m: float | None,
        now: float,
    ) -> Verdict: ...


def least(wanted: Velocity, permitted: Velocity) -> Velocity:
    """Limit a velocity to the permitted one: never faster, never the other way."""
    return _within(wanted[0], permitted[0]), _within(wanted[1], permitted[1])


def _within(wanted: float, permitted: float) -> float:
    # This also covers values that are not numbers.
    if not wanted * permitted > 0.0:
        return 0.0
    return permitted if abs(permitted) < abs(wanted) else wanted
