"""In place of a drive process, where none belongs to the station."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.drive.messages import DriveProcessCommand
from app.processes.errors import ProcessUnavailable
from app.station.contracts import DriveEvents


@dataclass(frozen=True)
class _NoHealth:
    generation: int = 0
    pid: int | None = None
    alive: bool = False
    restarts: int = 0
    heartbeat_age_s: float | None = None
    observations_lost: int = 0


class AbsentDrive:
    """Fulfils ``app.station.contracts.Drive`` by saying that nothing can be driven."""

    health = _NoHealth()

    async def start(self) -> None:
        pass

    async def stop(self) -> None:
        pass

    async def request(
        self, command: DriveProcessCommand, timeout_s: float = 1.0
    ) -> dict[str, Any]:
        """Always refused.

        Raises:
            ProcessUnavailable: as there is none.
        """
        del command, timeout_s
        raise ProcessUnavailable("this server drives no robots")

    def subscribe(self, callback: Callable[[DriveEvents], None]) -> Callable[[], None]:
        """Nothing ever happens."""
        del callback
        return lambda: None
