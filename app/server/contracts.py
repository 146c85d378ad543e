"""Interfaces of the server's processes and of its followers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from app.contract.commands import Answer, ToEngine
from app.contract.drive import FromDrive, ToDrive
from app.contract.events import Event, ObservationEvent
from app.runtime.latest import Latest
from app.runtime.supervisor import ProcessHealth


class LatestValue(Protocol):
    """Reading side of one latest-value slot."""

    def read(self, after: int = 0) -> Latest | None:
        """Return the newest value if its sequence is above ``after``; never wait."""
        ...


class _Process(Protocol):
    """Process of the server as seen by the web process."""

    async def start(self) -> None:
        """Start the process; ``EngineStartedEvent`` or ``DriveStartedEvent`` follows."""
        ...

    async def stop(self) -> None:
        """Stop the process, and with it all robots that it drives; safe to call twice."""
        ...

    @property
    def health(self) -> ProcessHealth: ...


class Engine(_Process, Protocol):
    """Engine process; implemented by ``EngineSupervisor``."""

    async def request(
        self, command: ToEngine[Answer], timeout_s: float = 10.0, *, repeatable: bool = False
    ) -> Answer:
        """Send a command and return the value of its reply.

        Args:
            repeatable: whether to send it again, to the next engine, if this one ends before it
                answers.

        Raises:
            ProcessRefused: the engine refused and said why.
            ProcessUnavailable: there is no engine at the moment, or it did not answer.
        """
        ...

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Pass every event to ``callback`` in the event loop; return an unsubscribe function."""
        ...

    @property
    def views(self) -> Mapping[str, LatestValue]: ...

    @property
    def cloud(self) -> LatestValue: ...


class Drive(_Process, Protocol):
    """Drive process; implemented by ``DriveSupervisor``."""

    async def request(self, command: ToDrive[Answer], timeout_s: float = 1.0) -> Answer:
        """Send a command and return the value of its reply.

        Raises:
            ProcessRefused: it refused and said why.
            ProcessUnavailable: there is no process at the moment, or it did not answer in time.
        """
        ...

    def subscribe(self, callback: Callable[[FromDrive], None]) -> Callable[[], None]:
        """Pass every event to ``callback`` in the event loop; return an unsubscribe function."""
        ...


class Listener(Protocol):
    """Follower of the server; called in the event loop, must not block."""

    def observed(self, event: ObservationEvent) -> None:
        """Handle the observation of a frame."""
        ...

    def status_changed(self) -> None:
        """Handle a change in the server's status, apart from figures that change all the time."""
        ...

    def robots_changed(self) -> None:
        """Handle a change in ``RobotManager.facts``; ten times a second while there are robots."""
        ...
