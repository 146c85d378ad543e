"""In place of a drive process, where none belongs to the server."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from app.contract.drive import DriveEvents, ToDrive
from app.runtime.errors import ProcessUnavailable
from app.runtime.supervisor import ProcessHealth


class AbsentDrive:
    """Fulfils ``app.server.contracts.Drive`` by saying that nothing can be driven."""

    health = ProcessHealth(
        generation=0, pid=None, alive=False, restarts=0, heartbeat_age_s=None, observations_lost=0
    )

    async def start(self) -> None:
        pass

    async def stop(self) -> None:
        pass

    async def request(self, command: ToDrive[Any], timeout_s: float = 1.0) -> Any:
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
