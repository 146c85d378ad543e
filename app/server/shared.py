"""What the parts of the server stand on, and what excludes what."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from app.server.background import Background
from app.server.contracts import Engine
from app.server.errors import Conflict
from app.server.followers import Followers
from app.server.telemetry import Telemetry
from app.server.writer import Writer
from app.storage import RunRecord, Storage


class Shared:
    """One change at a time; and a run or a calibration of cameras, never both.

    Attributes:
        clock: monotonic seconds. lock: held while source, run, calibration, parameters or rig
            are changed.
        run: gives the one that is kept. calibrates: tells whether cameras are being calibrated.
        writer: the way into the database. followers: who is told of everything.
        telemetry: figures of the running loop. background: work that nobody waits for.
        warnings: sentences for the person at the page.
    """

    def __init__(self, engine: Engine, storage: Storage, clock: Callable[[], float]) -> None:
        self.engine = engine
        self.storage = storage
        self.clock = clock
        self.lock = asyncio.Lock()
        self.run: Callable[[], RunRecord | None] = lambda: None
        self.calibrates: Callable[[], bool] = lambda: False
        self.writer = Writer()
        self.followers = Followers()
        self.telemetry = Telemetry()
        self.background = Background()
        self.warnings: list[str] = []

    def refuse_in_run(self, remedy: str) -> None:
        """
        Raises:
            Conflict: a run is going; the sentence ends with ``remedy``.
        """
        run = self.run()
        if run is not None:
            raise Conflict(f"the run {run.name} is going; {remedy}")

    def refuse_calibrating(self) -> None:
        """
        Raises:
            Conflict: cameras are being calibrated.
        """
        if self.calibrates():
            raise Conflict(
                "a calibration is being made; save it or leave it under Calibration first"
            )
