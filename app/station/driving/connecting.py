"""Giving the drive process the robots and guard parameters that it shall have."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

import structlog

from app.drive.messages import (
    ConnectRobot,
    DisconnectRobot,
    DriveProcessCommand,
    SetGuard,
    StopRobots,
)
from app.messages import StateEvent
from app.station.asking import ask_drive
from app.station.contracts import Drive
from app.station.errors import Conflict, FieldError, NotAvailable
from observer.rig.rig import ROLES, Rig, Role
from observer.robots.contract import RobotPort

log = structlog.get_logger(__name__)

# What live cameras see; see ``observer.guard.sight.Sight.world``.
REAL_WORLD = "real"
# A drive process that did not answer is asked again.
_RETRY_S = 1.0


def wanted_robots(state: StateEvent, rig: Rig) -> dict[Role, ConnectRobot]:
    """The robots that belong to the world which the open source shows.

    A source with robots of its own brings them along; live cameras go with the rig's ports. What
    is only replayed shows no world that could be driven in: a real robot is never driven by the
    sight of another world.
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
    own = [RobotPort(**fields) for fields in state.robots]
    return {
        robot.role: ConnectRobot(robot.role, robot.port, robot.model, world, robot.name)
        for robot in own
    }


class Connecting:
    """Tells each drive process what it lacks of what is wanted, one thing after the other.

    Attributes:
        trouble: why a role's robot could not be given, by role.
        complaint: why the guard's parameters could not be.
        stop_due: who asked for a stop that no drive process has confirmed yet.
        stopped: the latch as the drive process last told it; the next one begins with it.
    """

    def __init__(self, drive: Drive, guard: Callable[[], dict[str, Any]]) -> None:
        self._drive = drive
        self._guard = guard
        self._wanted: dict[Role, ConnectRobot] = {}
        # As this drive process was told, refused wishes too: they do not mend by repeating.
        self._told: dict[Role, ConnectRobot] = {}
        self._told_guard: dict[str, Any] = {}
        self._generation = 0
        self._due = asyncio.Event()
        self.trouble: dict[Role, str] = {}
        self.complaint: str | None = None
        self.stop_due: str | None = None
        self.stopped: dict[str, Any] | None = None

    def want(self, state: StateEvent, rig: Rig) -> None:
        """Have these robots from now on."""
        wanted = wanted_robots(state, rig)
        if wanted != self._wanted:
            self._wanted = wanted
            self._due.set()

    def look(self) -> None:
        """Something may be another."""
        self._due.set()

    def drive_started(self, generation: int) -> None:
        """A new process has nothing; a stop holds all the same."""
        if self.stop_due is None and self.stopped is not None:
            self.stop_due = str(self.stopped.get("by") or "the stop before")
        self._generation = generation
        self._forget()
        self._due.set()

    def drive_lost(self) -> None:
        """What it was told went with it."""
        self._generation = 0
        self._forget()

    def _forget(self) -> None:
        self._told, self._told_guard = {}, {}
        self.trouble.clear()
        self.complaint = None

    async def run(self) -> None:
        """Until cancelled."""
        again = False
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._due.wait(), _RETRY_S if again else None)
            self._due.clear()
            again = not await self._bring_up_to_date()

    async def _bring_up_to_date(self) -> bool:
        """Whether all was told, or is known to be refused."""
        generation = self._generation
        if generation == 0:
            # The next process is told when it has started.
            return True
        try:
            await self._tell_stop()
            await self._tell_guard()
            for role in ROLES:
                if self._generation == generation:
                    await self._tell_robot(role)
        except NotAvailable as error:
            log.warning("drive_not_told", reason=str(error))
            return False
        return True

    async def _tell_stop(self) -> None:
        if self.stop_due is not None:
            await ask_drive(self._drive, StopRobots(self.stop_due))
            self.stop_due = None

    async def _tell_guard(self) -> None:
        guard = self._guard()
        if guard and guard != self._told_guard:
            self.complaint = await self._refusal(SetGuard(guard))
            self._told_guard = guard

    async def _tell_robot(self, role: Role) -> None:
        wanted, told = self._wanted.get(role), self._told.get(role)
        if wanted == told:
            return
        generation = self._generation
        try:
            complaint = await self._refusal(DisconnectRobot(role) if wanted is None else wanted)
        except NotAvailable as error:
            self.trouble[role] = f"the {role} is not connected: {error}"
            raise
        if self._generation != generation:
            return
        if wanted is None:
            self._told.pop(role, None)
        else:
            self._told[role] = wanted
        self.trouble.pop(role, None)
        if complaint is not None:
            self.trouble[role] = f"the {role} is not connected: {complaint}"

    async def _refusal(self, command: DriveProcessCommand) -> str | None:
        """Why a command was refused for good, None where it was not."""
        try:
            await ask_drive(self._drive, command)
        except (FieldError, Conflict) as error:
            log.warning("drive_refused", command=type(command).__name__, reason=str(error))
            return str(error)
        return None
