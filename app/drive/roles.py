"""Roles of both robots together: commands in, velocities out, once a tick.

Nothing here waits or reads a clock; others open and close the robots (``robot_opener.py``).
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace

from pydantic import ValidationError

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    DriveCommand,
    IncidentEvent,
    Presence,
    ReleaseLease,
    ResetStop,
    SetGuard,
    StartGoal,
    StartProgramme,
    StopGoal,
    StopProgramme,
    StopRobots,
    TakeLease,
)
from app.contract.robots import GoalNow, Latch
from app.drive.connection import Connection, Tick
from app.drive.consent import ZERO
from app.drive.driven_role import DrivenRole
from app.drive.goals import Goals
from app.drive.leases import Leases
from app.drive.playing import Playing
from app.drive.robot_opener import RobotOpener
from app.runtime.errors import ProcessRefused
from observer.guard.guard import Guard
from observer.guard.parameters import GuardParameters, is_loosened
from observer.guard.sight import Sight
from observer.motion_profiles.playing import duration_s
from observer.navigation.errand import Errand
from observer.navigation.plan import Plan
from observer.rig.rig import OBSERVER, ROLES, Role
from observer.robot_opening import check_port
from observer.robots.models import robot_spec
from observer.robots.ports import shown_port
from observer.validation import validation_words, with_name

_log = logging.getLogger(__name__)

_GUARD = "guard."
# A ramp rises by at most this much time, however late a tick is.
_MOST_DT_S = 0.04
_FAILED = "was disconnected because its driver failed; see the log of the drive process"


@dataclass(frozen=True)
class DriveAnswer:
    """Drive command that was accepted; the velocity sent for it is known after the tick."""

    role: Role
    age_s: float


class Roles:
    """Roles of both robots; see the module.

    Attributes:
        openers: of each role's robots.
        stopped: the latched stop.
        playing: the programme in progress.
        goals: of the observer.
        leases: the lease of each role.
        sight: the newest sight.
    """

    def __init__(
        self,
        guard: Guard,
        openers: Mapping[Role, RobotOpener],
        parameters: GuardParameters,
    ) -> None:
        self._guard = guard
        self.openers = openers
        self._parameters = parameters
        self.driven: dict[Role, DrivenRole] = {role: DrivenRole(role, guard) for role in ROLES}
        self.leases = Leases()
        self.stopped: Latch | None = None
        self.playing: Playing | None = None
        self.goals = Goals()
        self.sight: Sight | None = None
        self._plan: Plan | None = None
        self._before: float | None = None
        self._incidents: list[IncidentEvent] = []

    # --- every tick ------------------------------------------------------------------------

    def step(self, now: float, sight: Sight | None, plan: Plan | None = None) -> None:
        """Run both robots' tick, once its commands were taken."""
        self.sight, self._plan = sight, plan
        for role in ROLES:
            self._take_opened(role)
        tick = self._tick(now)
        self._before = now
        for look in (self._look, self._send):
            for role in ROLES:
                try:
                    look(role, tick)
                except Exception:  # noqa: BLE001
                    _log.exception("the driver of the %s failed", role)
                    self._give_up(role, now)
        if self.playing is not None and self.playing.over(now):
            self._end_profile(now, None)

    def _look(self, role: Role, tick: Tick) -> None:
        played, driven = self._moving(role) is not None, self.driven[role]
        goes = role == OBSERVER and self.goals.driving
        trouble = driven.enforce_conditions(tick, played=played or goes)
        if played and trouble is not None:
            self._end_profile(tick.now, trouble)
        if role == OBSERVER:
            self._note(self.goals.update(driven, self.sight, self._plan, trouble, tick.now))

    def _send(self, role: Role, tick: Tick) -> None:
        playing, driven = self._moving(role), self.driven[role]
        if playing is not None:
            driven.drive(tick, playing.velocity(role, tick.now))
        elif role == OBSERVER:
            driven.drive(tick, self.goals.velocity(driven))
            self.goals.sent(driven)
        else:
            driven.drive(tick, None)

    def _note(self, incident: IncidentEvent | None) -> None:
        if incident is not None:
            self._incidents.append(incident)

    def _give_up(self, role: Role, now: float) -> None:
        """Release a robot whose driver fails; the other one continues."""
        driven = self.driven[role]
        connection, robot = driven.connection, driven.let_go()
        self._end_driving_of(role, now, _FAILED)
        self._incidents.append(IncidentEvent(role, "fault", f"the {role} {_FAILED}", now, None))
        if connection is not None:
            driven.connect(replace(connection, robot=None, trouble=f"the {role} {_FAILED}"))
        self.openers[role].close(robot)

    def _tick(self, now: float) -> Tick:
        return Tick(
            now,
            # Time lost by a stalled loop is not made up for.
            0.0 if self._before is None else min(now - self._before, _MOST_DT_S),
            self.sight,
            None if self.stopped is None else self.stopped.by,
            self._parameters,
        )

    def _take_opened(self, role: Role) -> None:
        opened = self.openers[role].opened()
        connection = self.driven[role].connection
        if opened is None or connection is None:
            return
        if isinstance(opened, str):
            self.driven[role].connect(replace(connection, trouble=opened))
        else:
            self.driven[role].connect(replace(connection, robot=opened))

    def incidents(self) -> list[IncidentEvent]:
        """Return the incidents since the last call."""
        incidents, self._incidents = self._incidents, []
        for driven in self.driven.values():
            incidents += driven.incidents()
        return incidents

    # --- commands --------------------------------------------------------------------------

    def take(self, command: object, now: float) -> str | float | DriveAnswer | GoalNow | None:
        """Carry out a command; return its answer, or a placeholder for one that follows.

        Raises:
            ProcessRefused, InputError: the reason, one sentence.
        """
        match command:
            case StopRobots():
                self.stop(command.by, now)
            case DriveCommand():
                return self._drive(command, now)
            case Presence():
                self._check_lease(command.role, command.lease)
                consent = self.driven[command.role].consent
                consent.take(command.sequence, command.issued, None, now)
            case ConnectRobot():
                self._connect(command, now)
            case DisconnectRobot():
                self._disconnect(command, now)
            case TakeLease():
                return self._take_lease(command, now)
            case ReleaseLease():
                self.leases.release(_checked(command.role), command.lease)
                self._lose_lease(command.role, now, "its operator released control")
            case ArmRobot():
                self._arm(command, now)
            case DisarmRobot():
                self._end_driving_of(_checked(command.role), now, "was disarmed")
                self.driven[command.role].disarm(now)
            case ResetStop():
                self.stopped = None
                for driven in self.driven.values():
                    driven.clear()
            case StartProgramme():
                return self._start_profile(command, now)
            case StopProgramme():
                self._end_profile(now, None)
            case StartGoal():
                return self._start_goal(command, now)
            case StopGoal():
                self._note(self.goals.give_up(self.driven[OBSERVER], None, now))
            case SetGuard():
                self._set_guard(command, now)
            case _:
                name = type(command).__name__
                raise ProcessRefused(f"{name} is unknown to the drive process", "input")
        return None

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

    def _drive(self, command: DriveCommand, now: float) -> DriveAnswer:
        self._check_lease(command.role, command.lease)
        driven = self.driven[command.role]
        velocity = (float(command.speed_mps), float(command.turn_rate_radps))
        age = driven.consent.take(command.sequence, command.issued, velocity, now)
        if velocity != ZERO:
            self._end_driving_of(command.role, now, "was driven manually in the meantime")
        return DriveAnswer(command.role, age)

    def _connect(self, command: ConnectRobot, now: float) -> None:
        role = _checked(command.role)
        check_port(command.port)
        # From here on the text goes to people and into records.
        shown = shown_port(command.port)
        if command.model is not None:
            robot_spec(command.model)
        for other, driven in self.driven.items():
            if other != role and driven.connection and driven.connection.port == shown:
                raise ProcessRefused(
                    f"{shown} is already the port of the {other}; choose another one for the "
                    f"{role}",
                    "input",
                )
        self._end_driving_of(role, now, "was reconnected")
        if role == OBSERVER:
            self.goals.forget()
        before = self.driven[role].connect(Connection(shown, command.world, command.name))
        opener = self.openers[role]
        opener.close(before)
        opener.open(command.port, command.model)

    def _disconnect(self, command: DisconnectRobot, now: float) -> None:
        role = _checked(command.role)
        self._end_driving_of(role, now, "was disconnected")
        self.openers[role].close(self.driven[role].connect(None))

    def _take_lease(self, command: TakeLease, now: float) -> str:
        role = _checked(command.role)
        lease, before = self.leases.take(role, command.operator, command.takeover)
        if before is not None:
            self._lose_lease(
                role, now, f"{command.operator} took control of the {role} from {before}"
            )
        return lease.id

    def _lose_lease(self, role: Role, now: float, sentence: str) -> None:
        self._end_driving_of(role, now, "lost its operator")
        self.driven[role].disarm(now, "lease", sentence)
        self.driven[role].new_operator()

    def _arm(self, command: ArmRobot, now: float) -> None:
        role = _checked(command.role)
        holder = self.leases.holder(role)
        if command.lease is not None:
            self.leases.check(role, command.lease)
        elif holder is not None:
            raise ProcessRefused(
                f"{holder} controls the {role}; only the operator in control may arm it", "state"
            )
        self.driven[role].arm(self._tick(now))

    def _check_lease(self, role: Role, lease: str) -> None:
        self.leases.check(_checked(role), lease)

    def _set_guard(self, command: SetGuard, now: float) -> None:
        values = {name.removeprefix(_GUARD): value for name, value in command.parameters.items()}
        try:
            parameters = GuardParameters.model_validate({**self._parameters.model_dump(), **values})
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(str(part) for part in first["loc"])
            said = with_name(f"{_GUARD}{name}", validation_words(first))
            raise ProcessRefused(said, "input") from None
        loosened = is_loosened(self._parameters, parameters)
        self._parameters = parameters
        self._guard.use(parameters)
        if loosened:
            # Anybody may change the parameters: whoever drives has consented to the stricter ones.
            for role, driven in self.driven.items():
                self._end_driving_of(role, now, "was driving when the guard was loosened")
                driven.ask_again(now, "the guard was loosened")

    # --- motion profiles -------------------------------------------------------------------

    def _start_profile(self, command: StartProgramme, now: float) -> float:
        profile = command.programme
        # An excessive number of repetitions is refused as ``InputError``.
        duration = duration_s(profile, command.repeat)
        if self.playing is not None:
            raise ProcessRefused(
                f"the programme {self.playing.profile.name} is running; stop it first",
                "state",
            )
        for role in profile.roles:
            lease = command.leases.get(role)
            if lease is None:
                raise ProcessRefused(
                    f"the programme {profile.name} moves the {role}; take control of it first",
                    "input",
                )
            self._check_attended(role, lease, now)
        if OBSERVER in profile.roles and self.goals.driving:
            raise ProcessRefused("the observer is driving to a goal; stop it first", "state")
        self.playing = Playing(profile, command.repeat, command.reverse, now)
        return duration

    def _check_attended(self, role: Role, lease: str, now: float) -> None:
        """Check that a robot may be moved without a hand on its controls.

        Raises:
            ProcessRefused: it is not armed, or its operator is not present or drives it.
        """
        self.leases.check(role, lease)
        driven = self.driven[role]
        driven.consent.expire(now)
        if not driven.armed:
            raise ProcessRefused(f"the {role} is not armed; arm it first", "state")
        if not driven.consent.present:
            raise ProcessRefused(
                f"no operator is present for the {role}; keep the page open and visible", "state"
            )
        if driven.consent.velocity != ZERO:
            raise ProcessRefused(
                f"the {role} is being driven manually; release the controls first", "state"
            )

    def _moving(self, role: Role) -> Playing | None:
        """Return the programme in progress if it moves this role."""
        playing = self.playing
        return playing if playing is not None and role in playing.profile.roles else None

    def _end_driving_of(self, role: Role, now: float, why: str) -> None:
        """End the programme or goal that moves a role."""
        sentence = f"the {role} {why}"
        if self._moving(role) is not None:
            self._end_profile(now, sentence)
        if role == OBSERVER:
            self._note(self.goals.give_up(self.driven[role], sentence, now))

    def _end_profile(self, now: float, why: str | None) -> None:
        """End the profile at zero; ``why`` it ends early, one sentence, None for a regular end."""
        playing, self.playing = self.playing, None
        if playing is None:
            return
        for role in playing.profile.roles:
            self.driven[role].rest()
        if why is not None:
            sentence = f"the programme {playing.profile.name} was stopped: {why}"
            self._incidents.append(IncidentEvent(None, "programme", sentence, now, None))

    # --- goals -----------------------------------------------------------------------------

    def _start_goal(self, command: StartGoal, now: float) -> GoalNow:
        self._check_attended(OBSERVER, command.lease, now)
        if (playing := self._moving(OBSERVER)) is not None:
            raise ProcessRefused(
                f"the programme {playing.profile.name} is running; stop it first", "state"
            )
        return self.goals.start(command, self.driven[OBSERVER], now).facts(now)

    def errand(self) -> Errand | None:
        """Return what a planner of the observer's path needs now; None without a goal."""
        return self.goals.errand(self.driven[OBSERVER])


def _checked(role: Role) -> Role:
    if role not in ROLES:
        raise ProcessRefused(
            f"{str(role)[:40]!r} is not a role; the roles are {' and '.join(ROLES)}", "input"
        )
    return role
