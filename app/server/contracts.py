"""What the server needs of its processes, and what others hear of the server."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from app.contract.commands import Answer, ToEngine
from app.contract.drive import DriveEvents, ToDrive
from app.contract.events import Event, ObservationEvent
from app.runtime.latest import Latest


class LatestValue(Protocol):
    """The reading side of one latest-value slot."""

    def read(self, after: int = 0) -> Latest | None:
        """The newest value if its sequence is above ``after``; never waits."""
        ...


class Health(Protocol):
    """How the engine process is."""

    @property
    def generation(self) -> int: ...

    @property
    def pid(self) -> int | None: ...

    @property
    def alive(self) -> bool: ...

    @property
    def restarts(self) -> int: ...

    @property
    def heartbeat_age_s(self) -> float | None: ...

    @property
    def observations_lost(self) -> int: ...


class Engine(Protocol):
    """The engine process as the web process sees it; ``app.supervisor.Supervisor`` fulfils it."""

    async def start(self) -> None:
        """Start the process; ``EngineStartedEvent`` follows."""
        ...

    async def stop(self) -> None:
        """End the process; safe to call twice."""
        ...

    async def request(self, command: ToEngine[Answer], timeout_s: float = 10.0) -> Answer:
        """Send a command and wait for its reply's value.

        Raises:
            EngineRefused: the engine said why not.
            EngineUnavailable: there is no engine to ask at this moment, or it did not answer.
        """
        ...

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Have every event handed to ``callback`` in the event loop; returns the unsubscription."""
        ...

    @property
    def health(self) -> Health: ...

    @property
    def views(self) -> Mapping[str, LatestValue]: ...

    @property
    def cloud(self) -> LatestValue: ...


class Drive(Protocol):
    """The drive process as the web process sees it; ``app.drive.supervisor`` fulfils it."""

    async def start(self) -> None:
        """Start the process; ``DriveStartedEvent`` follows."""
        ...

    async def stop(self) -> None:
        """Stop all robots and end the process; safe to call twice."""
        ...

    async def request(self, command: ToDrive[Answer], timeout_s: float = 1.0) -> Answer:
        """Send a command and wait for its reply's value.

        Raises:
            ProcessRefused: it said why not.
            ProcessUnavailable: there is none at this moment, or it did not answer in time.
        """
        ...

    def subscribe(self, callback: Callable[[DriveEvents], None]) -> Callable[[], None]:
        """Have every event handed to ``callback`` in the event loop; returns the unsubscription."""
        ...

    @property
    def health(self) -> Health: ...


class Listener(Protocol):
    """Somebody who follows the server; called in the event loop, must not block."""

    def observed(self, event: ObservationEvent) -> None:
        """A frame was observed."""
        ...

    def status_changed(self) -> None:
        """Something in ``Server.status`` changed, beside figures that always move."""
        ...

    def robots_changed(self) -> None:
        """``RobotManager.facts`` are others; ten times a second while robots are there."""
        ...
