"""A drive process within the test's own process, which keeps rules instead of driving."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from app.contract.drive import (
    COMMAND_FRESH_S,
    ArmRobot,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    DriveCommand,
    DriveLostEvent,
    DriveStartedEvent,
    DriveState,
    FromDrive,
    IncidentEvent,
    Presence,
    ReallySent,
    ReleaseLease,
    ResetStop,
    StartGoal,
    StartProgramme,
    StopGoal,
    StoppedEvent,
    StopProgramme,
    StopRobots,
    TakeLease,
    ToDrive,
    WheelSpeedEvent,
)
from app.contract.robots import (
    DriveFacts,
    DriveLoopFacts,
    GoalNow,
    Latch,
    ProgrammeNow,
    RobotNow,
    SightNow,
    Velocity,
)
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.supervisor import ProcessHealth
from observer.rig.rig import ROLES, Role
from observer.robots.contract import RobotPhase, RobotReport
from observer.robots.ports import shown_port


class FakeDrive:
    """Fulfils ``app.server.contracts.Drive``.

    Attributes:
        commands: all that were accepted. robots: the connected ones, by role.
        refuse: what to refuse, by the command's class: ``(refusal, sentence)``.
        hangs: whether it answers nothing. cannot_start: whether it never starts.
        stops_at_connecting: whether somebody stops all robots while one is being connected.
        watchdog_s: of the robots' reports.
    """

    def __init__(self) -> None:
        self.commands: list[ToDrive[Any]] = []
        self.subscribers: list[Callable[[FromDrive], None]] = []
        self.health = ProcessHealth(0, None, False, 0, None, 0)
        self.refuse: dict[type, tuple[Any, str]] = {}
        self.hangs = False
        self.cannot_start = False
        self.stops_at_connecting = False
        self.watchdog_s: float | None = 2.0
        self._leases = 0
        self._empty()

    def _empty(self) -> None:
        self.robots: dict[Role, ConnectRobot] = {}
        self.armed: set[Role] = set()
        self.leases: dict[Role, tuple[str, str]] = {}
        self.sequences: dict[str, int] = {}
        self.stopped: Latch | None = None
        self.programme: StartProgramme | None = None
        self.goal: GoalNow | None = None

    # --- as the supervisor -----------------------------------------------------------------

    async def start(self) -> None:
        if self.cannot_start:
            raise ProcessUnavailable("the drive process ended, 3 times in a row")
        self.start_process()

    def start_process(self) -> None:
        self._empty()
        generation = self.health.generation + 1
        pid = 2000 + generation
        self.health = ProcessHealth(generation, pid, True, generation - 1, None, 0)
        self.publish(DriveStartedEvent(generation, pid))
        self.tell()

    def lose(self, reason: str = "the drive process was killed") -> None:
        self.health = replace(self.health, alive=False, pid=None)
        self.publish(DriveLostEvent(self.health.generation, reason))

    async def stop(self) -> None:
        self.health = replace(self.health, alive=False, pid=None)

    def subscribe(self, callback: Callable[[FromDrive], None]) -> Callable[[], None]:
        self.subscribers.append(callback)
        return lambda: self.subscribers.remove(callback)

    def publish(self, event: FromDrive) -> None:
        for callback in tuple(self.subscribers):
            callback(event)

    async def request(self, command: ToDrive[Any], timeout_s: float = 1.0) -> Any:
        if not self.health.alive:
            raise ProcessUnavailable("the drive process is being replaced")
        self.commands.append(command)
        if self.hangs:
            await asyncio.sleep(timeout_s)
            raise ProcessUnavailable(f"the drive process did not answer within {timeout_s:g} s")
        refused = self.refuse.get(type(command))
        if refused is not None:
            raise ProcessRefused(refused[1], refused[0])
        value = self._do(command)
        self.tell()
        return value

    # --- as the process --------------------------------------------------------------------

    def _do(self, command: ToDrive[Any]) -> Any:
        match command:
            case ConnectRobot():
                self.robots[command.role] = command
                self.armed.discard(command.role)
                if self.stops_at_connecting:
                    self.stopped = Latch("somebody", time.monotonic())
            case DisconnectRobot():
                self.robots.pop(command.role, None)
                self.armed.discard(command.role)
            case TakeLease():
                return self._take(command)
            case ReleaseLease():
                self._check(command.role, command.lease)
                del self.leases[command.role]
                self.armed.discard(command.role)
            case ArmRobot():
                self._arm(command)
            case DisarmRobot():
                self.armed.discard(command.role)
            case StopRobots():
                self.armed.clear()
                self.stopped = Latch(command.by, time.monotonic())
            case ResetStop():
                self.stopped = None
            case DriveCommand() | Presence():
                return self._drive(command)
            case StartProgramme():
                for role in command.programme.roles:
                    if role not in self.armed:
                        raise ProcessRefused(f"the {role} is not armed", "state")
                self.programme = command
            case StopProgramme():
                self.programme = None
            case StartGoal():
                self._check("observer", command.lease)
                self.goal = _goal(command)
                return self.goal
            case StopGoal():
                if self.goal is not None:
                    self.goal = replace(
                        self.goal, state="ended", sentence="The goal was cancelled."
                    )
        return None

    def _take(self, command: TakeLease) -> str:
        held = self.leases.get(command.role)
        if held is not None and not command.takeover:
            raise ProcessRefused(f"{held[1]} drives the {command.role}", "state")
        self._leases += 1
        lease = f"lease-{self._leases}"
        self.leases[command.role] = (lease, command.operator)
        self.armed.discard(command.role)
        return lease

    def _check(self, role: Role, lease: str) -> None:
        if self.leases.get(role, ("", ""))[0] != lease:
            raise ProcessRefused(f"you no longer control the {role} is not in force", "state")

    def _arm(self, command: ArmRobot) -> None:
        if self.stopped is not None:
            raise ProcessRefused("all robots are stopped; reset the stop first", "state")
        if command.role not in self.robots:
            raise ProcessRefused(f"the {command.role} is not connected", "state")
        if command.role in self.leases or command.lease is not None:
            self._check(command.role, command.lease or "")
        self.armed.add(command.role)

    def _drive(self, command: DriveCommand | Presence) -> ReallySent | None:
        self._check(command.role, command.lease)
        age = time.monotonic() - command.issued
        if age > COMMAND_FRESH_S:
            raise ProcessRefused("the command is too old", "state")
        if command.sequence <= self.sequences.get(command.lease, -1):
            raise ProcessRefused("the sequence number of the command is old", "state")
        self.sequences[command.lease] = command.sequence
        if isinstance(command, Presence):
            return None
        moves = command.role in self.armed
        return ReallySent(
            speed_mps=max(-0.3, min(0.3, command.speed_mps)) if moves else 0.0,
            turn_rate_radps=command.turn_rate_radps if moves else 0.0,
            limited_by=None if moves else "not armed",
            age_s=age,
        )

    # --- what it reports ---------------------------------------------------------------------

    def tell(self, **more: Any) -> None:
        """Publish the state of all robots."""
        self.publish(DriveState(replace(self.facts(), **more), time.monotonic()))

    def facts(self) -> DriveFacts:
        programme = self.programme
        return DriveFacts(
            stopped=self.stopped,
            sight=SightNow(0.05, "ok", "real"),
            loop=DriveLoopFacts(5, 0.4, 1.5, "normal", 0),
            programme=None
            if programme is None
            else ProgrammeNow(
                programme.programme.name, "driving", 1, 0.0, 1.0, programme.repeat, False
            ),
            goal=self.goal,
            robots={role: self._robot(role) for role in ROLES},
        )

    def _robot(self, role: Role) -> RobotNow | None:
        robot = self.robots.get(role)
        if robot is None:
            return None
        return RobotNow(
            port=shown_port(robot.port),
            name=robot.name,
            world=robot.world,
            state="armed" if role in self.armed else "disarmed",
            operator=self.leases.get(role, (None, None))[1],
            present=False,
            why=None if role in self.armed else "not armed",
            commanded=Velocity(0.0, 0.0),
            sent=Velocity(0.0, 0.0),
            guard=None,
            report=RobotReport(RobotPhase.CONNECTED, battery_v=12.3, watchdog_s=self.watchdog_s),
        )

    def measure(self, role: Role, sent: float, encoder: float | None, ago_s: float = 0.0) -> None:
        """Publish a robot's speeds, as happens ten times a second while it is armed."""
        self.publish(WheelSpeedEvent(role, time.monotonic() - ago_s, sent, encoder))

    def come_to_rest(self, role: Role, kind: Any, sentence: str, **more: Any) -> None:
        """Stop a robot driving at 0.25 m/s: publish the incident, then the measured stop."""
        now = time.monotonic()
        self.publish(IncidentEvent(role, kind, sentence, now - 0.7, 0.25))
        values = {
            "cause_time": now - 0.9,
            "zero_time": now - 0.7,
            "stood_time": now - 0.4,
            "speed_mps": 0.25,
            "before_mps": 0.25,
            "distance_m": 0.09,
            "separation_m": None,
            **more,
        }
        self.publish(StoppedEvent(role, kind, sentence, now - 0.7, **values))

    def of(self, *kinds: type) -> list[Any]:
        """Return the commands of some kinds, in order."""
        return [command for command in self.commands if isinstance(command, kinds)]


def _goal(command: StartGoal) -> GoalNow:
    place = (command.ahead_m, command.left_m)
    return GoalNow(
        state="driving",
        sentence="Driving to the goal.",
        place=place,
        distance_m=math.hypot(*place),
        elapsed_s=0.0,
        path=[(0.0, 0.0), place],
        risk_per_metre=command.risk_per_metre,
        planned_risk_per_metre=0.0,
        waits_for=None,
        meets_s=None,
    )
