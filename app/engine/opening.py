"""Opening a source without stopping the loop: it may take long, and then may even hang."""

from __future__ import annotations

import threading
from collections.abc import Callable

from app.engine.played_source import OpeningCommand, PlayedSource
from app.runtime.requests import Request
from observer.guard.parameters import AllParameters


class Opening:
    """A source that is being opened in a thread of its own.

    Attributes:
        request, command: what asked for it.
        session, error: the result, one of them, once it is done.
        abandoned: nobody waits for it any more; its session is only to be closed.
        lender: the session whose source it was given, and which goes on if it is refused.
        before: what was open and had to be closed for it, to be opened again if it is refused.
        parameters: with their revision, where they were set meanwhile.
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
        """Begin; ``done`` is called in the other thread when there is a result."""

        def run() -> None:
            try:
                self.session = work()
            except Exception as error:  # noqa: BLE001
                # Nothing may be lost between threads; the loop tells refused from broken.
                self.error = error
            done(self)

        threading.Thread(target=run, name="opening a source", daemon=True).start()
