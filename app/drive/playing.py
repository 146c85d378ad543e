"""Motion profile in progress."""

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
    """Motion profile since its start.

    Attributes:
        started: the host's monotonic clock.
    """

    profile: MotionProfile
    repeat: int
    reverse: bool
    started: float

    def over(self, now: float) -> bool:
        """Return true once it has been played to its end."""
        return self._sample(self.profile.roles[0], now) is None

    def velocity(self, role: Role, now: float) -> Velocity:
        """Return the velocity for a role at this instant; zero after the end."""
        return self._sample(role, now) or ZERO

    def facts(self, now: float) -> ProgrammeNow:
        """Return the facts as ``DriveState.facts`` holds them."""
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
