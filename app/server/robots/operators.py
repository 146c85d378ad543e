"""Operators of the robots: each open drive socket is one, and its leases end with it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

import structlog

from app.contract.drive import ReleaseLease, TakeLease, ToDrive
from app.contract.robots import Robots
from app.server.errors import Conflict, FieldError, NotAvailable
from observer.rig.rig import Role

log = structlog.get_logger(__name__)

_LONGEST_NAME = 40
# Consecutive events that must name another holder before a lease counts as lost: one event may have
# been sent just before the reply that granted the lease.
_TIMES_UNNAMED = 2


@dataclass(eq=False)
class Operator:
    """Person at an open drive socket.

    Attributes:
        name: name shown to others, unique among operators.
        lost: called with the role and a sentence when a lease ends without being released.
        browser: identity of their browser; None for a script.
        leases: leases by role.
    """

    name: str
    lost: Callable[[Role, str], None]
    browser: object | None = None
    leases: dict[Role, str] = field(default_factory=dict)
    gone: bool = False
    unnamed: dict[Role, int] = field(default_factory=dict)


class Operators:
    """Registry of all operators; used in the event loop.

    Args:
        ask: sends a command to the drive process and raises the server's errors.
        soon: runs the sending of a release in the background.
    """

    def __init__(
        self,
        ask: Callable[[ToDrive[Any]], Awaitable[Any]],
        soon: Callable[[Awaitable[None]], None],
    ) -> None:
        self._ask = ask
        self._soon = soon
        self._present: set[Operator] = set()
        self._numbered = 0

    def join(
        self, name: str | None, lost: Callable[[Role, str], None], browser: object | None = None
    ) -> Operator:
        """Register an operator, under the given name if it is readable and free.

        Args:
            browser: identity of their browser; None for a script.
        """
        self._numbered += 1
        wanted = "".join(c for c in (name or "") if c.isprintable()).strip()[:_LONGEST_NAME]
        name = wanted = wanted or f"operator {self._numbered}"
        number = self._numbered
        while any(operator.name == name for operator in self._present):
            name, number = f"{wanted} ({number})", number + 1
        operator = Operator(name, lost, browser)
        self._present.add(operator)
        return operator

    def leave(self, operator: Operator) -> None:
        """Remove an operator whose socket closed: its robots stop and become free."""
        operator.gone = True
        self._present.discard(operator)
        leases, operator.leases = operator.leases, {}
        for role, lease in leases.items():
            log.info("lease_ended_with_its_socket", role=role, operator=operator.name)
            self._soon(self._release(role, lease, lost=True))

    async def take(self, operator: Operator, role: Role, *, takeover: bool) -> str:
        """Take the lease on a role and return it; return the operator's existing one, if any.

        Raises:
            Conflict: somebody else holds it. FieldError, NotAvailable: as for ``ask_drive``.
        """
        if role in operator.leases:
            return operator.leases[role]
        lease: str = await self._ask(TakeLease(role, operator.name, takeover))
        if operator.gone:
            # The socket closed while the drive process answered.
            self._soon(self._release(role, lease, lost=True))
            return lease
        taken_from = [o for o in self._present - {operator} if o.leases.pop(role, None) is not None]
        operator.leases[role] = lease
        operator.unnamed.pop(role, None)
        log.info("lease_taken", role=role, operator=operator.name)
        for other in taken_from:
            log.warning("lease_taken_over", role=role, by=operator.name, before=other.name)
            other.lost(role, f"{operator.name} took control of the {role}")
        return lease

    async def release(self, operator: Operator, role: Role) -> None:
        """Release a lease, if there is one."""
        lease = operator.leases.pop(role, None)
        if lease is not None:
            await self._release(role, lease, lost=False)

    def holder(self, role: Role) -> str | None:
        """Return the name of the role's holder."""
        return next((each.name for each in self._present if role in each.leases), None)

    def name_at(self, browser: object) -> str | None:
        """Return the name of the one operator at a browser; None if there is none, or several."""
        names = [each.name for each in self._present if each.browser is browser]
        return names[0] if len(names) == 1 else None

    def drive_said(self, robots: Robots) -> None:
        """End leases that the drive process no longer knows.

        Args:
            robots: the robots in its facts.
        """
        for operator in tuple(self._present):
            for role in tuple(operator.leases):
                robot = robots.get(role)
                if robot is None or robot.operator == operator.name:
                    operator.unnamed.pop(role, None)
                    continue
                operator.unnamed[role] = operator.unnamed.get(role, 0) + 1
                if operator.unnamed[role] >= _TIMES_UNNAMED:
                    self._lose(operator, role, robot.why or f"control of the {role} was released")

    def drive_lost(self, sentence: str) -> None:
        """End all leases, which were lost with the drive process."""
        for operator in tuple(self._present):
            for role in tuple(operator.leases):
                self._lose(operator, role, sentence)

    def _lose(self, operator: Operator, role: Role, sentence: str) -> None:
        del operator.leases[role]
        operator.unnamed.pop(role, None)
        log.warning("lease_lost", role=role, operator=operator.name, reason=sentence)
        operator.lost(role, sentence)

    async def _release(self, role: Role, lease: str, *, lost: bool) -> None:
        try:
            await self._ask(ReleaseLease(role, lease, lost))
        except (Conflict, FieldError, NotAvailable) as error:
            # Either the lease is no longer valid or it was lost with its process.
            log.info("lease_not_released", role=role, reason=str(error))
