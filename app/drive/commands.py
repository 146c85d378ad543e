"""Commands to the robots: each is checked and carried out at the beginning of a tick.

Nothing here waits or reads a clock.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import ValidationError

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    DriveCommand,
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
from app.contract.robots import GoalNow
from app.drive.connection import Connection
from app.drive.consent import ZERO
from app.drive.playing import Playing
from app.drive.roles import Roles
from app.runtime.errors import ProcessRefused
from observer.guard.parameters import GuardParameters
from observer.motion_profiles.playing import duration_s
from observer.rig.rig import OBSERVER, ROLES, Role
from observer.robot_opening import check_port
from observer.robots.models import robot_spec
from observer.robots.ports import shown_port
from observer.validation import validation_words, with_name

_GUARD = "guard."


@dataclass(frozen=True)
class DriveAnswer:
    """Drive command that was accepted; the velocity sent for it is known after the tick."""

    role: Role
    age_s: float


class Commands:
    """Commands to both robots, whose state is that of ``roles``."""

    def __init__(self, roles: Roles) -> None:
        self._roles = roles

    def take(self, command: object, now: float) -> str | float | DriveAnswer | GoalNow | None:
        """Carry out a command; return its answer, or a placeholder for one that follows.

        Raises:
            ProcessRefused, InputError: the reason, one sentence.
        """
        match command:
            case StopRobots():
                self._roles.stop(command.by, now)
            case DriveCommand():
                return self._drive(command, now)
            case Presence():
                self._check_lease(command.role, command.lease)
                consent = self._roles.driven[command.role].consent
                consent.take(command.sequence, command.issued, None, now)
            case ConnectRobot():
                self._connect(command, now)
            case DisconnectRobot():
                self._disconnect(command, now)
            case TakeLease():
                return self._take_lease(command, now)
            case ReleaseLease():
                self._roles.leases.release(_checked(command.role), command.lease)
                how = "is no longer connected" if command.lost else "released control"
                self._lose_lease(command.role, now, f"its operator {how}")
            case ArmRobot():
                self._arm(command, now)
            case DisarmRobot():
                self._roles.end_driving_of(_checked(command.role), now, "was disarmed")
                self._roles.driven[command.role].disarm(now)
            case ResetStop():
                self._roles.reset()
            case StartProgramme():
                return self._start_programme(command, now)
            case StopProgramme():
                self._roles.end_programme(now, None)
            case StartGoal():
                return self._start_goal(command, now)
            case StopGoal():
                self._roles.note(self._roles.goals.give_up(self._roles.driven[OBSERVER], None, now))
            case SetGuard():
                self._set_guard(command, now)
            case _:
                name = type(command).__name__
                raise ProcessRefused(f"{name} is unknown to the drive process", "input")
        return None

    def _drive(self, command: DriveCommand, now: float) -> DriveAnswer:
        self._check_lease(command.role, command.lease)
        driven = self._roles.driven[command.role]
        velocity = (float(command.speed_mps), float(command.turn_rate_radps))
        age = driven.consent.take(command.sequence, command.issued, velocity, now)
        if velocity != ZERO:
            self._roles.end_driving_of(command.role, now, "was driven manually in the meantime")
        return DriveAnswer(command.role, age)

    def _connect(self, command: ConnectRobot, now: float) -> None:
        role = _checked(command.role)
        check_port(command.port)
        # From here on the text goes to people and into records.
        shown = shown_port(command.port)
        if command.model is not None:
            robot_spec(command.model)
        for other, driven in self._roles.driven.items():
            if other != role and driven.connection and driven.connection.port == shown:
                raise ProcessRefused(
                    f"{shown} is already the port of the {other}; choose another one for the "
                    f"{role}",
                    "input",
                )
        self._roles.end_driving_of(role, now, "was reconnected")
        if role == OBSERVER:
            self._roles.goals.forget()
        before = self._roles.driven[role].connect(Connection(shown, command.world, command.name))
        opener = self._roles.openers[role]
        opener.close(before)
        opener.open(command.port, command.model)

    def _disconnect(self, command: DisconnectRobot, now: float) -> None:
        role = _checked(command.role)
        self._roles.end_driving_of(role, now, "was disconnected")
        self._roles.openers[role].close(self._roles.driven[role].connect(None))

    def _take_lease(self, command: TakeLease, now: float) -> str:
        role = _checked(command.role)
        lease, before = self._roles.leases.take(role, command.operator, command.takeover)
        if before is not None:
            self._lose_lease(
                role, now, f"{command.operator} took control of the {role} from {before}"
            )
        return lease.id

    def _lose_lease(self, role: Role, now: float, sentence: str) -> None:
        self._roles.end_driving_of(role, now, "lost its operator")
        self._roles.driven[role].disarm(now, "lease", sentence)
        self._roles.driven[role].new_operator()

    def _arm(self, command: ArmRobot, now: float) -> None:
        role = _checked(command.role)
        holder = self._roles.leases.holder(role)
        if command.lease is not None:
            self._roles.leases.check(role, command.lease)
        elif holder is not None:
            raise ProcessRefused(
                f"{holder} controls the {role}; only the operator in control may arm it", "state"
            )
        self._roles.driven[role].arm(self._roles.tick(now))

    def _check_lease(self, role: Role, lease: str) -> None:
        self._roles.leases.check(_checked(role), lease)

    def _set_guard(self, command: SetGuard, now: float) -> None:
        values = {name.removeprefix(_GUARD): value for name, value in command.parameters.items()}
        try:
            parameters = GuardParameters.model_validate(
                {**self._roles.parameters.model_dump(), **values}
            )
        except ValidationError as error:
            first = error.errors()[0]
            name = ".".join(str(part) for part in first["loc"])
            said = with_name(f"{_GUARD}{name}", validation_words(first))
            raise ProcessRefused(said, "input") from None
        self._roles.use_guard(parameters, now)

    def _start_programme(self, command: StartProgramme, now: float) -> float:
        profile = command.programme
        # An excessive number of repetitions is refused as ``InputError``.
        duration = duration_s(profile, command.repeat)
        if self._roles.playing is not None:
            raise ProcessRefused(
                f"the programme {self._roles.playing.profile.name} is running; stop it first",
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
        if OBSERVER in profile.roles and self._roles.goals.driving:
            raise ProcessRefused("the observer is driving to a goal; stop it first", "state")
        self._roles.playing = Playing(profile, command.repeat, command.reverse, now)
        return duration

    def _check_attended(self, role: Role, lease: str, now: float) -> None:
        """Check that a robot may be moved without a hand on its controls.

        Raises:
            ProcessRefused: it is not armed, or its operator is not present or drives it.
        """
        self._roles.leases.check(role, lease)
        driven = self._roles.driven[role]
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

    def _start_goal(self, command: StartGoal, now: float) -> GoalNow:
        self._check_attended(OBSERVER, command.lease, now)
        if (playing := self._roles.moving(OBSERVER)) is not None:
            raise ProcessRefused(
                f"the programme {playing.profile.name} is running; stop it first", "state"
            )
        return self._roles.goals.start(command, self._roles.driven[OBSERVER], now).facts(now)


def _checked(role: Role) -> Role:
    if role not in ROLES:
        raise ProcessRefused(
            f"{str(role)[:40]!r} is not a role; the roles are {' and '.join(ROLES)}", "input"
        )
    return role
