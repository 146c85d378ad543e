"""A motion profile while it is played."""

from __future__ import annotations

from dataclasses import dataclass

from app.contract.robots import ProgrammeNow
from app.contract.values import filled
from app.drive.consent import ZERO, Velocity
from observer.motion_profiles.playing import progress_at, velocity_at
from observer.motion_profiles.profile import MotionProfile
from observer.rig.rig import Role


@dataclass(frozen=True)
class Playing:
    """A motion profile since its beginning.

    Attributes:
        started: the host's monotonic clock.
    """

    profile: MotionProfile
    repeat: int
    reverse: bool
    started: float

    @property
    def roles(self) -> tuple[Role, ...]:
        """Those it moves."""
        return self.profile.roles

    def over(self, now: float) -> bool:
        """Whether it is played to its end."""
        return self._sample(self.roles[0], now) is None

    def velocity(self, role: Role, now: float) -> Velocity:
        """What the role shall drive at this instant; zero behind the end."""
        return self._sample(role, now) or ZERO

    def facts(self, now: float) -> ProgrammeNow:
        """As ``DriveEvent.facts`` has it."""
        progress = progress_at(self.profile, now - self.started, self.repeat)
        return filled(
            ProgrammeNow,
            progress,
            name=self.profile.name,
            repeat=self.repeat,
            reverse=self.reverse,
        )

    def _sample(self, role: Role, now: float) -> Velocity | None:
        return velocity_at(
            self.profile,
            role,
            now - self.started,
            repeat=self.repeat,
            reverse=self.reverse,
        )
