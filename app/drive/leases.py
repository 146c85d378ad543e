"""Leases of the robots: at most one driver each at a time."""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from app.runtime.errors import ProcessRefused
from observer.rig.rig import Role


@dataclass(frozen=True)
class Lease:
    """Right to drive a role. Only its holder knows the ``id``; everybody knows the ``operator``."""

    id: str
    operator: str


class Leases:
    """Leases of all roles."""

    def __init__(self) -> None:
        self._held: dict[Role, Lease] = {}

    def holder(self, role: Role) -> str | None:
        """Return the operator who holds the role's lease."""
        lease = self._held.get(role)
        return None if lease is None else lease.operator

    def take(self, role: Role, operator: str, takeover: bool) -> tuple[Lease, str | None]:
        """Return a new lease, and the operator who lost one to it.

        Raises:
            ProcessRefused: somebody holds one, and the request does not take it over.
        """
        before = self.holder(role)
        if before is not None and not takeover:
            raise ProcessRefused(
                f"{before} controls the {role}; take control to drive it yourself", "state"
            )
        lease = Lease(secrets.token_hex(8), operator)
        self._held[role] = lease
        return lease, before

    def check(self, role: Role, lease: str) -> None:
        """Check that this is the role's lease.

        Raises:
            ProcessRefused: the lease is not valid.
        """
        held = self._held.get(role)
        if held is None or held.id != lease:
            who = "nobody" if held is None else held.operator
            raise ProcessRefused(
                f"you no longer control the {role}, {who} does; take control again", "state"
            )

    def release(self, role: Role, lease: str) -> None:
        """Release the lease.

        Raises:
            ProcessRefused: the lease is not valid.
        """
        self.check(role, lease)
        del self._held[role]
