"""Scripted robots, guard and openers, and a bench whose clock the test sets."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DriveCommand,
    IncidentEvent,
    Presence,
    TakeLease,
)
from app.drive.commands import Commands
from app.drive.roles import Roles
from app.runtime.errors import ProcessRefused
from observer.guard.guard import Guard, Verdict, sight_trouble
from observer.guard.parameters import GuardParameters
from observer.guard.sight import Sight
from observer.navigation.plan import Plan
from observer.rig.rig import ROLES, Role
from observer.robots.contract import RobotPhase, RobotReport, Sent
from observer.types import Odometry, Status

TICK_S = 0.02


class ScriptedRobot:
    """Obeys instantly, and records its commands."""

    def __init__(self, port: str = "/dev/robot") -> None:
        self.port = port
        self.now = 0.0
        self.calls: list[tuple[Any, ...]] = []
        self.state = RobotReport(
            RobotPhase.CONNECTED,
            received=0.0,
            odometry=Odometry(0.0, 0.0, 0.0),
            speed_mps=0.0,
            turn_rate_radps=0.0,
            motors_enabled=False,
        )
        self.most = math.inf
        # Sends no reports of its own accord, only those of ``change``.
        self.silent = False

    def report(self) -> RobotReport:
        return self.state

    def change(self, **values: Any) -> None:
        self.state = replace(self.state, **values)

    def enable(self) -> None:
        self.calls.append(("enable",))
        self.change(motors_enabled=True)

    def disable(self) -> None:
        self.calls.append(("disable",))
        self.change(motors_enabled=False)

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        moves = self.state.motors_enabled and self.state.fault is None
        speed = min(max(speed_mps, -self.most), self.most) if moves else 0.0
        turn = turn_rate_radps if moves else 0.0
        self.calls.append(("drive", speed, turn))
        return Sent(speed, turn, self.now)

    def stop(self) -> None:
        self.calls.append(("stop",))
        self.change(motors_enabled=False)

    def clear(self) -> None:
        self.calls.append(("clear",))
        self.change(fault=None)

    def close(self) -> None:
        self.calls.append(("close",))

    @property
    def velocities(self) -> list[tuple[float, float]]:
        return [call[1:] for call in self.calls if call[0] == "drive"]


class ScriptedGuard(Guard):
    """Permits everything while the observer's sight is usable, or gives the test's ``answers``."""

    def __init__(self) -> None:
        super().__init__(GuardParameters())
        self.answers: dict[Role, Any] = {}
        self.parameters: list[GuardParameters] = []
        self.sights: list[tuple[Role, Sight | None]] = []

    def use(self, parameters: GuardParameters) -> None:
        self.parameters.append(parameters)

    def forget(self, role: Role) -> None:
        pass

    def limit(self, role: Role, wanted: tuple[float, float], *more: Any) -> Verdict:
        self.sights.append((role, more[1]))
        answer = self.answers.get(role)
        if isinstance(answer, Exception):
            raise answer
        if answer is not None:
            return answer
        sight, world, now = more[1], more[2], more[-1]
        trouble = sight_trouble(sight, now, world) if role == "observer" else None
        if trouble is not None:
            return Verdict("stop", True, 0.0, 0.0, trouble, 0.0, (), ())
        return Verdict("clear", False, *wanted, None, None, (), ())


class ScriptedOpener:
    """Has the robot that a test prepared, or a sentence that says why there is none."""

    def __init__(self, prepared: ScriptedRobot | str) -> None:
        self.prepared = prepared
        self.closed: list[Any] = []
        self.ports: list[str] = []
        self._due: ScriptedRobot | str | None = None

    def open(self, port: str, model: str | None) -> None:
        del model
        self.ports.append(port)
        self._due = self.prepared

    def close(self, robot: Any) -> None:
        self._due = None
        if robot is not None:
            self.closed.append(robot)

    def opened(self) -> Any:
        due, self._due = self._due, None
        return due


class Bench:
    """Both roles, with a clock that the test controls."""

    def __init__(self) -> None:
        self.now = 100.0
        self.robots = {role: ScriptedRobot(f"/dev/{role}") for role in ROLES}
        self.guard = ScriptedGuard()
        self.openers = {role: ScriptedOpener(self.robots[role]) for role in ROLES}
        self.parameters = GuardParameters()
        self.roles = Roles(self.guard, self.openers, self.parameters)  # type: ignore[arg-type]
        self.commands = Commands(self.roles)
        self.leases: dict[Role, str] = {}
        self.sequence = 0
        self.frame = 0
        self.sight: Sight | None = None
        self.plan: Plan | None = None
        # None: no new frames arrive.
        self.seeing: dict[str, Any] | None = {}
        self.incidents: list[IncidentEvent] = []

    def see(self, **more: Any) -> None:
        self.frame += 1
        values = {
            "world": "real",
            "status": Status.OK,
            "reasons": (),
            "mount_known": True,
            **more,
        }
        self.sight = Sight(frame=self.frame, received=self.now, published=self.now, **values)

    def pass_time(self) -> None:
        """Pass a tick's time, in which the robots report."""
        self.now += TICK_S
        for robot in self.robots.values():
            if not robot.silent:
                robot.change(received=self.now)

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.pass_time()
            if self.seeing is not None:
                self.see(**self.seeing)
            self.roles.step(self.now, self.sight, self.plan)
            self.incidents += self.roles.incidents()

    def run(self, seconds: float) -> None:
        self.tick(round(seconds / TICK_S))

    def take(self, command: Any) -> Any:
        return self.commands.take(command, self.now)

    def connect(self, role: Role, world: str = "real") -> None:
        assert self.take(ConnectRobot(role, self.robots[role].port, None, world)) is None
        self.tick()

    def lease(self, role: Role, operator: str = "Ann", takeover: bool = False) -> str:
        self.leases[role] = self.take(TakeLease(role, operator, takeover))
        return self.leases[role]

    def arm(self, role: Role) -> None:
        self.take(ArmRobot(role, self.leases.get(role)))

    def ready(self, role: Role) -> None:
        """Connect, lease and arm it."""
        self.connect(role)
        self.lease(role)
        self.arm(role)

    def drive(self, role: Role, speed: float, turn: float = 0.0, *, age_s: float = 0.0) -> Any:
        self.sequence += 1
        issued = self.now - age_s
        return self.take(DriveCommand(role, self.leases[role], self.sequence, issued, speed, turn))

    def present(self, role: Role) -> None:
        self.sequence += 1
        self.take(Presence(role, self.leases[role], self.sequence, self.now))

    def hold(self, role: Role, speed: float, seconds: float, turn: float = 0.0) -> None:
        """Hold a key: send a command ten times a second."""
        for _ in range(round(seconds / 0.1)):
            self.drive(role, speed, turn)
            self.tick(5)

    def stay(self, role: Role, seconds: float) -> None:
        """Keep the page open: be present ten times a second."""
        for _ in range(round(seconds / 0.1)):
            self.present(role)
            self.tick(5)

    def sent(self, role: Role) -> tuple[float, float]:
        return self.roles.driven[role].sent

    def state(self, role: Role) -> str | None:
        return self.roles.driven[role].state

    def why(self, role: Role) -> str | None:
        return self.roles.driven[role].hindrance

    def kinds(self) -> list[str]:
        return [incident.kind for incident in self.incidents]


def refused(bench: Bench, command: Any, match: str, kind: str = "state") -> None:
    """Assert that the command is refused with this kind and a matching sentence."""
    with pytest.raises(ProcessRefused, match=match) as error:
        bench.take(command)
    assert error.value.refusal == kind


def driving(bench: Bench) -> None:
    """Bring both roles to speed."""
    bench.ready("observer")
    bench.ready("obstacle")
    for _ in range(15):
        bench.drive("observer", 0.3)
        bench.drive("obstacle", 0.3)
        bench.tick(5)


def both(bench: Bench, seconds: float) -> None:
    """Hold both keys."""
    for _ in range(round(seconds / 0.1)):
        bench.drive("observer", 0.3)
        bench.drive("obstacle", 0.3)
        bench.tick(5)
