"""Re-arming of a programme's robots that reopening the source has reconnected, disarmed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass

from app.contract.drive import ArmRobot, StartProgramme
from app.contract.robots import DRIVEN_STATES, DriveFacts, RobotNow
from app.server.errors import Conflict
from app.server.robots.connecting import Connecting
from observer.rig.rig import ROLES, Role
from observer.robots.ports import shown_port

# A reconnected simulated robot reports within a second or two.
_ARM_WITHIN_S = 8.0
_ARM_AGAIN_S = 0.1


@dataclass(frozen=True)
class ArmedRobot:
    """A programme's robot as it was when the programme was requested: armed.

    Attributes:
        connections, disarmings: the role's counts of assigned robots and of requests to disarm.
    """

    connections: int
    disarmings: int


class Rearming:
    """Re-arms a programme's robots, unless anything but the reopening has disarmed them."""

    def __init__(
        self,
        connecting: Connecting,
        facts: Callable[[], DriveFacts],
        arm: Callable[[ArmRobot], Awaitable[RobotNow | None]],
        clock: Callable[[], float],
    ) -> None:
        """Set up.

        Args:
            connecting: counts the robots assigned. facts: returns the newest from the drive
                process. arm: sends it the command. clock: the host's monotonic clock.
        """
        self._connecting = connecting
        self._facts = facts
        self._arm = arm
        self._clock = clock
        # Per role: requests after which the robot must stay disarmed until somebody arms it.
        self._disarmings = dict.fromkeys(ROLES, 0)

    def count_disarming(self, roles: Iterable[Role]) -> None:
        """Note that robots are being disarmed, whether or not they are armed."""
        for role in roles:
            self._disarmings[role] += 1

    def armed_robots(self, start: StartProgramme) -> dict[Role, ArmedRobot]:
        """Return the programme's robots, armed; call it before opening anything for it.

        Raises:
            Conflict: a robot is not armed.
        """
        for role in start.programme.roles:
            if not self._is_driven(role):
                raise Conflict(f"the {role} is not armed; arm it first")
        return {
            role: ArmedRobot(self._connecting.connections[role], self._disarmings[role])
            for role in start.programme.roles
        }

    async def arm_again(self, start: StartProgramme, before: Mapping[Role, ArmedRobot]) -> None:
        """Re-arm those of the programme's robots that reopening the source has reconnected.

        Do this only for the operator who has just requested the programme, and who holds the leases
        of robots that were armed.

        Args:
            before: from ``armed_robots``.

        Raises:
            Conflict: they cannot be armed, or not in time, or were disarmed or stopped meanwhile.
        """
        deadline = self._clock() + _ARM_WITHIN_S
        for role in before:
            while not await self._armed(role, before, start.leases.get(role), deadline):
                await asyncio.sleep(_ARM_AGAIN_S)

    async def _armed(
        self, role: Role, before: Mapping[Role, ArmedRobot], lease: str | None, deadline: float
    ) -> bool:
        late = self._clock() > deadline
        self._refuse_disarmed(before)
        given, robot = self._connecting.given(role), self._facts().robots.get(role)
        if given is None or robot is None:
            if late:
                raise Conflict(f"the {role} was not reconnected in time")
            return False
        if (robot.port, robot.world) != (shown_port(given.port), given.world):
            # The last report is about the previous robot.
            return False
        if self._is_driven(role):
            return True
        if self._connecting.connections[role] == before[role].connections:
            # Still connected as before, so it was not the reopening that disarmed it.
            raise _disarmed(role)
        try:
            await self._arm(ArmRobot(role, lease))
        except Conflict:
            if late:
                raise
            return False
        return True

    def _refuse_disarmed(self, before: Mapping[Role, ArmedRobot]) -> None:
        if self._facts().stopped is not None:
            raise Conflict("all robots were stopped; reset the stop first")
        for role, armed in before.items():
            if self._disarmings[role] != armed.disarmings:
                raise _disarmed(role)

    def _is_driven(self, role: Role) -> bool:
        robot = self._facts().robots.get(role)
        return robot is not None and robot.state in DRIVEN_STATES


def _disarmed(role: Role) -> Conflict:
    return Conflict(
        f"the {role} was disarmed while the run was starting; arm it, then start the run again"
    )
