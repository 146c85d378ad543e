"""Roles of both robots together: once a tick each robot is sent a velocity, or a standstill.

Nothing here waits or reads a clock. ``commands.py`` carries out what is asked; others open and
close the robots (``robot_opener.py``).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

from app.contract.drive import IncidentEvent
from app.contract.robots import Latch
from app.drive.connection import Tick
from app.drive.driven_role import DrivenRole
from app.drive.goals import Goals
from app.drive.leases import Leases
from app.drive.playing import Playing
from app.drive.robot_opener import RobotOpener
from observer.guard.guard import Guard
from observer.guard.parameters import GuardParameters, is_loosened
from observer.guard.sight import Sight
from observer.navigation.errand import Errand
from observer.navigation.plan import Plan
from observer.rig.rig import OBSERVER, ROLES, Role

_log = logging.getLogger(__name__)

# A ramp rises by at most this much time, however late a tick is.
_MOST_DT_S = 0.04
_FAILED = "was disconnected because its driver failed; see the log of the drive process"


class Roles:
    """Roles of both robots; see the module.

    Attributes:
        openers: of each role's robots.
        stopped: the latched stop.
        playing: the programme in progress.
        goals: of the observer.
        leases: the lease of each role.
        sight: the newest sight.
        parameters: the guard's.
    """

    def __init__(
        self,
        guard: Guard,
        openers: Mapping[Role, RobotOpener],
        parameters: GuardParameters,
    ) -> None:
        self._guard = guard
        self.openers = openers
        self.parameters = parameters
        self.driven: dict[Role, DrivenRole] = {role: DrivenRole(role, guard) for role in ROLES}
        self.leases = Leases()
        self.stopped: Latch | None = None
        self.playing: Playing | None = None
        self.goals = Goals()
        self.sight: Sight | None = None
        self._plan: Plan | None = None
        self._before: float | None = None
        self._incidents: list[IncidentEvent] = []

    def step(self, now: float, sight: Sight | None, plan: Plan | None = None) -> None:
        """Run both robots' tick, once its commands were taken."""
        self.sight, self._plan = sight, plan
        for role in ROLES:
            self._take_opened(role)
        tick = self.tick(now)
        self._before = now
        for look in (self._look, self._send):
            for role in ROLES:
                try:
                    look(role, tick)
                except Exception:  # noqa: BLE001
                    _log.exception("the driver of the %s failed", role)
                    self._give_up(role, now)
        if self.playing is not None and self.playing.over(now):
            self.end_programme(now, None)

    def _look(self, role: Role, tick: Tick) -> None:
        played, driven = self.moving(role) is not None, self.driven[role]
        goes = role == OBSERVER and self.goals.driving
        trouble = driven.enforce_conditions(tick, played=played or goes)
        if played and trouble is not None:
            self.end_programme(tick.now, trouble)
        if role == OBSERVER:
            self.note(self.goals.update(driven, self.sight, self._plan, trouble, tick.now))

    def _send(self, role: Role, tick: Tick) -> None:
        playing, driven = self.moving(role), self.driven[role]
        if playing is not None:
            driven.drive(tick, playing.velocity(role, tick.now))
        elif role == OBSERVER:
            driven.drive(tick, self.goals.velocity(driven))
            self.goals.sent(driven)
        else:
            driven.drive(tick, None)

    def _give_up(self, role: Role, now: float) -> None:
        """Release a robot whose driver fails; the other one continues."""
        driven = self.driven[role]
        connection, robot = driven.connection, driven.let_go()
        self.end_driving_of(role, now, _FAILED)
        self._incidents.append(IncidentEvent(role, "fault", f"the {role} {_FAILED}", now, None))
        if connection is not None:
            driven.connect(replace(connection, robot=None, trouble=f"the {role} {_FAILED}"))
        self.openers[role].close(robot)

    def _take_opened(self, role: Role) -> None:
        opened = self.openers[role].opened()
        connection = self.driven[role].connection
        if opened is None or connection is None:
            return
        if isinstance(opened, str):
            self.driven[role].connect(replace(connection, trouble=opened))
        else:
            self.driven[role].connect(replace(connection, robot=opened))

    def tick(self, now: float) -> Tick:
        """Return what applies to both robots at this instant."""
        return Tick(
            now,
            # Time lost by a stalled loop is not made up for.
            0.0 if self._before is None else min(now - self._before, _MOST_DT_S),
            self.sight,
            None if self.stopped is None else self.stopped.by,
            self.parameters,
        )

    def note(self, incident: IncidentEvent | None) -> None:
        """Keep an incident, if there is one, for ``incidents``."""
        if incident is not None:
            self._incidents.append(incident)

    def incidents(self) -> list[IncidentEvent]:
        """Return the incidents since the last call."""
        incidents, self._incidents = self._incidents, []
        for driven in self.driven.values():
            incidents += driven.incidents()
        return incidents

    def errand(self) -> Errand | None:
        """Return what a planner of the observer's path needs now; None without a goal."""
        return self.goals.errand(self.driven[OBSERVER])

    # --- asked for by commands --------------------------------------------------------------

    def stop(self, by: str, now: float) -> None:
        """Stop all robots and latch the stop."""
        for role, driven in self.driven.items():
            try:
                driven.stop()
            except Exception:  # noqa: BLE001
                # A failure of one robot must not keep the other from being stopped.
                _log.exception("the stop command could not be sent to the %s", role)
        self.playing = None
        self.goals.give_up(self.driven[OBSERVER], f"all robots were stopped by {by}", now)
        if self.stopped is None:
            self.stopped = Latch(by, now)
            speeds = [driven.report.speed_mps for driven in self.driven.values() if driven.report]
            fastest = max((speed for speed in speeds if speed is not None), key=abs, default=None)
            self._incidents.append(
                IncidentEvent(None, "stop", f"all robots were stopped by {by}", now, fastest)
            )

    def reset(self) -> None:
        """Release the latched stop, and clear both robots' faults."""
        self.stopped = None
        for driven in self.driven.values():
            driven.clear()

    def use_guard(self, parameters: GuardParameters, now: float) -> None:
        """Let the guard use other parameters from now on."""
        loosened = is_loosened(self.parameters, parameters)
        self.parameters = parameters
        self._guard.use(parameters)
        if loosened:
            # Anybody may change the parameters: whoever drives has consented to the stricter ones.
            for role, driven in self.driven.items():
                self.end_driving_of(role, now, "was driving when the guard was loosened")
                driven.ask_again(now, "the guard was loosened")

    def moving(self, role: Role) -> Playing | None:
        """Return the programme in progress if it moves this role."""
        playing = self.playing
        return playing if playing is not None and role in playing.profile.roles else None

    def end_driving_of(self, role: Role, now: float, why: str) -> None:
        """End the programme or goal that moves a role."""
        sentence = f"the {role} {why}"
        if self.moving(role) is not None:
            self.end_programme(now, sentence)
        if role == OBSERVER:
            self.note(self.goals.give_up(self.driven[role], sentence, now))

    def end_programme(self, now: float, why: str | None) -> None:
        """End the programme at zero.

        Args:
            why: it ends early, one sentence; None for a regular end.
        """
        playing, self.playing = self.playing, None
        if playing is None:
            return
        for role in playing.profile.roles:
            self.driven[role].rest()
        if why is not None:
            sentence = f"the programme {playing.profile.name} was stopped: {why}"
            self._incidents.append(IncidentEvent(None, "programme", sentence, now, None))
