"""Opening of a source without blocking the loop: it may take long, or even hang."""

from __future__ import annotations

import threading
from collections.abc import Callable

from app.engine.played_source import OpeningCommand, PlayedSource
from app.runtime.requests import Request
from observer.guard.parameters import AllParameters


class Opening:
    """Source that is being opened in its own thread.

    Attributes:
        request, command: the request that asked for it.
        session, error: the result; one of them is set once it is done.
        abandoned: nobody waits for it any more; its session only needs to be closed.
        lender: the session that lent its source, and that goes on if the opening is refused.
        before: the session that had to be closed for it, to be reopened if the opening is refused.
        parameters: with their revision, if they were set meanwhile.
    """

    def __init__(self, request: Request, command: OpeningCommand) -> None:
        self.request = request
        self.command = command
        self.session: PlayedSource | None = None
        self.error: Exception | None = None
        self.abandoned = False
        self.lender: PlayedSource | None = None
        self.before: OpeningCommand | None = None
        self.parameters: tuple[AllParameters, int] | None = None

    def start(self, work: Callable[[], PlayedSource], done: Callable[[Opening], None]) -> None:
        """Start opening; ``done`` is called in the other thread when there is a result."""

        def run() -> None:
            try:
                self.session = work()
            except Exception as error:  # noqa: BLE001
                # No exception may be lost between threads; the loop tells refusals from faults.
                self.error = error
            done(self)

        threading.Thread(target=run, name="opening a source", daemon=True).start()
