"""Stand-in for a drive process on a server without one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from app.contract.drive import FromDrive, ToDrive
from app.runtime.errors import ProcessUnavailable
from app.runtime.supervisor import ProcessHealth


class AbsentDrive:
    """Implementation of ``app.server.contracts.Drive`` that refuses everything."""

    health = ProcessHealth(
        generation=0, pid=None, alive=False, restarts=0, heartbeat_age_s=None, observations_lost=0
    )

    async def start(self) -> None:
        pass

    async def stop(self) -> None:
        pass

    async def request(self, command: ToDrive[Any], timeout_s: float = 1.0) -> Any:
        """Refuse every request.

        Raises:
            ProcessUnavailable: always, because there is no drive process.
        """
        del command, timeout_s
        raise ProcessUnavailable("this server controls no robots")

    def subscribe(self, callback: Callable[[FromDrive], None]) -> Callable[[], None]:
        """Accept a subscription; no event ever follows."""
        del callback
        return lambda: None
