"""Supply of robots and guard parameters to the drive process."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from functools import partial

import structlog

from app.contract.drive import (
    ConnectRobot,
    DisconnectRobot,
    SetGuard,
    StopRobots,
    ToDrive,
)
from app.contract.events import StateEvent
from app.contract.parameters import ParameterValues
from app.contract.robots import Latch
from app.server.asking import ask_drive
from app.server.contracts import Drive
from app.server.errors import Conflict, FieldError, NotAvailable
from observer.guard.sight import REAL_WORLD
from observer.rig.rig import ROLES, Rig, Role

log = structlog.get_logger(__name__)

# Delay before an unanswered command is repeated.
_RETRY_S = 1.0
# The previous robot disconnects first, which takes up to 2 s.
_CONNECT_TIMEOUT_S = 10.0


def wanted_robots(state: StateEvent, rig: Rig) -> dict[Role, ConnectRobot]:
    """Return the robots that belong to the world shown by the open source.

    A source may bring its own robots; live cameras use the rig's ports. A replayed source shows no
    world to drive in: a real robot is never driven by images of another world.
    """
    world = state.world
    if world is None:
        return {}
    if world == REAL_WORLD:
        return {
            role: ConnectRobot(role, rig.ports[role], rig.models.get(role), world)
            for role in ROLES
            if role in rig.ports
        }
    return {
        robot.role: ConnectRobot(robot.role, robot.port, robot.model, world, robot.name)
        for robot in state.robots
    }


class Connecting:
    """Synchroniser that sends each drive process what it lacks of the wanted state.

    One robot's port never delays the other's; no robot is assigned before the stop and the guard's
    parameters have been sent.

    Attributes:
        trouble: why a robot could not be assigned, by role.
        complaint: why the guard's parameters were refused.
        stop_due: who asked for a stop that no drive process has confirmed yet.
        stopped: the stop latch as last reported by the drive process; the next process begins with
            it.
        connections: count of the robots assigned so far, by role.
    """

    def __init__(self, drive: Drive, guard: Callable[[], ParameterValues]) -> None:
        self._drive = drive
        self._guard = guard
        self._wanted: dict[Role, ConnectRobot] = {}
        # What was sent to this drive process, including refused requests, which are not repeated.
        # A role is missing while its state is unknown, because the process has not answered.
        self._assigned: dict[Role, ConnectRobot | None] = {}
        self._assigned_guard: ParameterValues = {}
        # Generation of the present process (0: none), and of the one that received stop and guard.
        self._generation = 0
        self._ready_generation = 0
        self._settings_due = asyncio.Event()
        self._robot_due = {role: asyncio.Event() for role in ROLES}
        self.trouble: dict[Role, str] = {}
        self.complaint: str | None = None
        self.stop_due: str | None = None
        self.stopped: Latch | None = None
        self.connections = dict.fromkeys(ROLES, 0)

    def want(self, state: StateEvent, rig: Rig) -> None:
        """Set the robots wanted from now on."""
        self._wanted = wanted_robots(state, rig)
        for due in self._robot_due.values():
            due.set()

    def settings_changed(self) -> None:
        """Have a stop or changed guard parameters sent."""
        self._settings_due.set()

    def drive_started(self, generation: int) -> None:
        """Send a new process everything again; a stop remains latched."""
        if self.stop_due is None and self.stopped is not None:
            self.stop_due = self.stopped.by
        self._generation = generation
        self._forget()
        self._settings_due.set()

    def drive_lost(self) -> None:
        """Forget what was sent to the lost process."""
        self._generation = 0
        self._forget()

    def _forget(self) -> None:
        self._assigned, self._assigned_guard = dict.fromkeys(ROLES), {}
        self._ready_generation = 0
        self.trouble.clear()
        self.complaint = None

    def given(self, role: Role) -> ConnectRobot | None:
        """Return the robot assigned to the drive process, if it is the wanted one."""
        assigned = self._assigned.get(role)
        return assigned if assigned == self._wanted.get(role) and role not in self.trouble else None

    async def run(self) -> None:
        """Run until cancelled."""
        async with asyncio.TaskGroup() as keeping:
            keeping.create_task(_keep(self._settings_due, self._tell_settings))
            for role, due in self._robot_due.items():
                keeping.create_task(_keep(due, partial(self._tell_robot, role)))

    async def _tell_settings(self) -> None:
        generation = self._generation
        if generation == 0:
            # The settings are sent once the next process has started.
            return
        if self.stop_due is not None:
            await ask_drive(self._drive, StopRobots(self.stop_due))
            self.stop_due = None
        guard = self._guard()
        if guard and guard != self._assigned_guard:
            self.complaint = await self._refusal(SetGuard(guard))
            self._assigned_guard = guard
        if self._generation == generation:
            self._ready_generation = generation
            for due in self._robot_due.values():
                due.set()

    async def _tell_robot(self, role: Role) -> None:
        generation = self._ready_generation
        wanted = self._wanted.get(role)
        if generation == 0 or (role in self._assigned and self._assigned[role] == wanted):
            return
        self._assigned.pop(role, None)
        if wanted is not None:
            self.connections[role] += 1
        try:
            complaint = await self._refusal(
                DisconnectRobot(role) if wanted is None else wanted, _CONNECT_TIMEOUT_S
            )
        except NotAvailable as error:
            if self._ready_generation == generation:
                self.trouble[role] = f"the {role} is not connected: {error}"
            raise
        if self._ready_generation != generation:
            return
        self._assigned[role] = wanted
        self.trouble.pop(role, None)
        if complaint is not None:
            self.trouble[role] = f"the {role} is not connected: {complaint}"

    async def _refusal(self, command: ToDrive[None], timeout_s: float = 1.0) -> str | None:
        """Send a command; return why it was permanently refused, or None if it was accepted."""
        try:
            await ask_drive(self._drive, command, timeout_s=timeout_s)
        except (FieldError, Conflict) as error:
            log.warning("drive_refused", command=type(command).__name__, reason=str(error))
            return str(error)
        return None


async def _keep(due: asyncio.Event, tell: Callable[[], Awaitable[None]]) -> None:
    """Send whenever due, and retry after a missing reply."""
    again = False
    while True:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_RETRY_S if again else None):
                await due.wait()
        due.clear()
        try:
            await tell()
        except NotAvailable as error:
            log.warning("drive_not_notified", reason=str(error))
            again = True
        else:
            again = False
