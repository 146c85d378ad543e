"""Common parts of the server, and the rules of mutual exclusion."""

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
    """Common parts; they allow one change at a time, and either a run or a calibration of cameras.

    Attributes:
        clock: monotonic seconds. lock: held while source, run, calibration, parameters or rig
            are changed.
        run: returns the run in progress. calibrates: returns whether cameras are being calibrated.
        writer: writes to the database. followers: receivers of all events.
        telemetry: figures of the running loop. background: background tasks.
        warnings: sentences for the user of the page.
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
        """Refuse to go on while a run is in progress.

        Raises:
            Conflict: a run is in progress; the sentence ends with ``remedy``.
        """
        run = self.run()
        if run is not None:
            raise Conflict(f"the run {run.name} is going; {remedy}")

    def refuse_calibrating(self) -> None:
        """Refuse to go on while cameras are being calibrated.

        Raises:
            Conflict: cameras are being calibrated.
        """
        if self.calibrates():
            raise Conflict(
                "a calibration is being made; save it or leave it under Calibration first"
            )
