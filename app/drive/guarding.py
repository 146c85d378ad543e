"""The guard as one role asks it: its last verdict, and why that may not be relied on."""

from __future__ import annotations

import logging

from app.drive.connection import Tick
from app.drive.consent import Velocity
from observer.guard.guard import Guard, Verdict, sight_trouble
from observer.guard.outline import Outline
from observer.rig.rig import Role
from observer.robots.contract import RobotReport

_log = logging.getLogger(__name__)
_FAILED = "the guard failed; see the log of the drive process"


class AskedGuard:
    """The guard, asked for one role.

    Attributes:
        verdict: the last one; None while there is no robot.
    """

    def __init__(self, role: Role, guard: Guard) -> None:
        self._role: Role = role
        self._guard = guard
        self.verdict: Verdict | None = None
        # Why it cannot judge a usable sight, as when it failed, one sentence.
        self._trouble: str | None = None

    def ask(self, report: RobotReport, tick: Tick, world: str, wanted: Velocity) -> Verdict:
        """Return what it permits of the wanted velocity; a standstill if it fails.

        Args:
            report: the robot's last one. world: the one that the robot is in.
        """
        verdict = self._limit(report, tick, world, wanted)
        self.verdict, self._trouble = verdict, None
        # Trouble with the sight itself is looked up anew at each tick, so that it ends with the
        # first good frame.
        if verdict.blind and sight_trouble(tick.sight, tick.now, world) is None:
            self._trouble = verdict.reason or "the guard cannot rely on the camera view"
        return verdict

    def blindness(self, tick: Tick, world: str) -> str | None:
        """Return why nothing may be driven by this sight, one sentence."""
        return sight_trouble(tick.sight, tick.now, world) or self._trouble

    def withdraw(self) -> None:
        """Drop the verdict: nothing was asked for."""
        self.verdict = self._trouble = None

    def forget(self) -> None:
        """Drop the verdict and what the guard remembers of this role's path."""
        self.withdraw()
        self._guard.forget(self._role)

    def _limit(self, report: RobotReport, tick: Tick, world: str, wanted: Velocity) -> Verdict:
        try:
            return self._guard.limit(
                self._role,
                wanted,
                (report.speed_mps, report.turn_rate_radps),
                tick.sight if self._role == "observer" else None,
                world,
                report.sonars,
                Outline.of(report.length_m, report.width_m, report.radius_m),
                tick.now,
            )
        except Exception as error:  # noqa: BLE001
            # Whatever fails in the guard, the robots stop, and the loop goes on to report it.
            if self.verdict is None or self.verdict.reason != _FAILED:
                _log.exception("the guard failed: %s", type(error).__name__)
            return Verdict("stop", True, 0.0, 0.0, _FAILED, 0.0, (), ())
