"""Common parts of the server, and the rules of mutual exclusion."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import Callable
from dataclasses import replace

from app.contract.answers import Opened
from app.contract.commands import BeginCalibration, CancelOpening, OpenSource
from app.server.asking import ask
from app.server.background import Background
from app.server.contracts import Engine
from app.server.errors import Conflict, NotAvailable
from app.server.followers import Followers
from app.server.telemetry import Telemetry
from app.server.writer import Writer
from app.storage import RunRecord, Storage
from observer.opening import shown_spec

# Indexing a large data set takes a while. The first limit is extended, up to the second, while the
# engine prepares itself.
_OPEN_TIMEOUT_S, _LONGEST_OPENING_S = 60.0, 3600.0


class Shared:
    """Common parts; they allow one change at a time, and either a run or a calibration of cameras.

    Attributes:
        clock: monotonic seconds. lock: held while source, run, calibration, parameters or rig
            are changed.
        run: returns the run in progress. calibrates: returns whether cameras are being calibrated.
        preparing: returns whether the engine must prepare itself before it can open anything.
        writer: writes to the database. followers: receivers of all events.
        telemetry: figures of the running loop. background: background tasks.
        warnings: sentences for the user of the page.
        opened_by: generation of the engine that last opened a source; 0 if none has.
    """

    def __init__(self, engine: Engine, storage: Storage, clock: Callable[[], float]) -> None:
        self.engine = engine
        self.storage = storage
        self.clock = clock
        self.lock = asyncio.Lock()
        self.run: Callable[[], RunRecord | None] = lambda: None
        self.calibrates: Callable[[], bool] = lambda: False
        self.preparing: Callable[[], bool] = lambda: False
        self.writer = Writer()
        self.followers = Followers()
        self.telemetry = Telemetry()
        self.background = Background()
        self.warnings: list[str] = []
        self.opened_by = 0
        self._openings = itertools.count(1)

    async def open_in_engine(self, command: OpenSource | BeginCalibration) -> Opened:
        """Have the engine open a source; if it ends before that, have the next one open it.

        An opening that nobody waits for any longer is cancelled in the engine too.

        Raises:
            FieldError: the source cannot be opened; the previous one stays open.
            Conflict, StorageFull, NotAvailable: as for ``ask``.
        """
        command = replace(command, opening=next(self._openings))
        asking = asyncio.create_task(self._ask_to_open(command))
        try:
            while not (await asyncio.wait({asking}, timeout=_OPEN_TIMEOUT_S))[0]:
                if not self.preparing():
                    raise NotAvailable(
                        f"{shown_spec(command.source)} did not open within {_OPEN_TIMEOUT_S:g} s"
                    )
            return asking.result()
        except (NotAvailable, asyncio.CancelledError) as error:
            asking.cancel()
            await self._cancel_opening(command.opening, error)
            raise

    async def _ask_to_open(self, command: OpenSource | BeginCalibration) -> Opened:
        opened = await ask(
            self.engine,
            command,
            field=("body", "source"),
            timeout_s=_LONGEST_OPENING_S,
            repeatable=True,
        )
        # Set at once: a moment later another engine may be running that has not opened anything.
        self.opened_by = self.engine.health.generation
        return opened

    async def _cancel_opening(self, opening: int, error: BaseException) -> None:
        """Tell the engine to give an opening up.

        Otherwise it would go on with it, refuse every other source meanwhile and, in the end,
        record a run that is no longer known here.
        """
        reason = str(error) or "the request to open it was withdrawn"
        # An engine that does not answer is replaced, and the opening ends with it.
        with contextlib.suppress(NotAvailable):
            await ask(self.engine, CancelOpening(opening, reason))

    def refuse_in_run(self, remedy: str) -> None:
        """Refuse to go on while a run is in progress.

        Raises:
            Conflict: a run is in progress; the sentence ends with ``remedy``.
        """
        run = self.run()
        if run is not None:
            raise Conflict(f"the run {run.name} is in progress; {remedy}")

    def refuse_calibrating(self) -> None:
        """Refuse to go on while cameras are being calibrated.

        Raises:
            Conflict: cameras are being calibrated.
        """
        if self.calibrates():
            raise Conflict(
                "a calibration is in progress; save or cancel it under Calibration first"
            )
