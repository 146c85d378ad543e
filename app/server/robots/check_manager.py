"""Manager of the guided check in progress and of the records of finished ones."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import structlog

from app.contract.drive import StoppedEvent
from app.contract.robots import CheckNow, ChecksNow, Robots
from app.server.errors import Conflict, FieldError
from app.server.robots.check_records import CheckRecords, advice
from app.server.robots.circumstances import Circumstances
from app.server.robots.guard_check import GuardCheck
from app.server.robots.time_of_day import time_of_day
from app.storage import StorageError
from observer.rig.rig import Role

log = structlog.get_logger(__name__)


class CheckManager:
    """Manager of one check at a time.

    Used in the event loop; files are read and written in threads.

    Attributes:
        records: records of finished checks.
    """

    def __init__(
        self,
        folder: Path | None,
        circumstances: Callable[[], Circumstances],
        *,
        changed: Callable[[], None],
        soon: Callable[[Coroutine[Any, Any, None]], None],
        clock: Callable[[], float],
    ) -> None:
        """Set up without a check.

        Args:
            folder: folder of the records; None stores none. circumstances: current ones.
            changed: called when ``facts`` change. soon: runs work in the background.
            clock: the host's monotonic clock, on which stops are timed.
        """
        self.records = CheckRecords(folder)
        self._circumstances = circumstances
        self._changed = changed
        self._soon = soon
        self._clock = clock
        self._check: GuardCheck | None = None
        self._saving = asyncio.Lock()
        self._saved: str | None = None
        self._trouble: str | None = None

    # --- events of the drive process -------------------------------------------------------

    def drive_said(self, robots: Robots) -> None:
        """Handle the robots' state from ``DriveState.facts``."""
        if self._check is not None:
            self._check.robot_said(robots.get(self._check.role))

    def stopped(self, event: StoppedEvent) -> None:
        """Handle the stop of a moving robot."""
        check = self._check
        if check is None or check.over():
            return
        check.stopped(event, time_of_day(self._clock() - event.cause_time))
        self._changed()
        if check.over():
            self._soon(self._save_or_tell())

    # --- requests --------------------------------------------------------------------------

    def facts(self) -> CheckNow | None:
        """Return the check in progress, or the last one that ended; None if there is none."""
        if self._check is None:
            return None
        facts = self._check.facts()
        return CheckNow(**vars(facts), record=self._saved, trouble=self._trouble)

    async def outlook(self, role: Role) -> ChecksNow:
        """Return the check, and the reason to check (again)."""
        newest = await asyncio.to_thread(self.records.newest, role)
        return ChecksNow(self.facts(), advice(newest, self._circumstances(), datetime.now(UTC)))

    def start(self, role: Role, note: str | None, by: str) -> None:
        """Start a check.

        Raises:
            Conflict: a check is in progress, or the last one is not stored yet.
        """
        if self._check is not None and not self._check.over():
            raise Conflict(f"a check of the {self._check.role} is in progress; abort it first")
        if self._unsaved:
            raise Conflict("the previous check is not saved yet; abort it first")
        self._check = GuardCheck(
            role, self._circumstances(), started_at=time_of_day(), started_by=by, note=note
        )
        self._saved = self._trouble = None
        log.info("guard_check_started", role=role, by=by)
        self._changed()

    async def skip(self, by: str) -> None:
        """Skip the present step.

        Raises:
            Conflict: no check is in progress. FieldError, StorageFull: the check ended with this
                step but could not be stored; it is kept, and ``give_up`` retries.
        """
        check = self._going()
        check.skip(by, time_of_day())
        self._changed()
        if check.over():
            await self._save()

    async def give_up(self, by: str) -> None:
        """End the check in its present state and store it.

        If it has already ended but is not stored yet, just store it.

        Raises:
            Conflict: no check is in progress. FieldError, StorageFull: it could not be stored.
        """
        if self._unsaved:
            await self._save()
            return
        self._going().give_up(by, time_of_day())
        self._changed()
        await self._save()

    async def close(self) -> None:
        """Store a check that is not stored yet, at the server's shutdown."""
        check = self._check
        if check is not None and self._saved is None:
            check.give_up("the server shutting down", time_of_day())
            await self._save_or_tell()

    def _going(self) -> GuardCheck:
        if self._check is None or self._check.over():
            raise Conflict("no check is in progress; start one first")
        return self._check

    @property
    def _unsaved(self) -> bool:
        check = self._check
        return check is not None and check.over() and self._saved is None

    # --- storing ---------------------------------------------------------------------------

    async def _save(self) -> None:
        async with self._saving:
            check = self._check
            if check is None or self._saved is not None:
                return
            record = check.record(self._circumstances())
            try:
                self._saved = await asyncio.to_thread(self.records.save, record)
            except (Conflict, FieldError, StorageError) as error:
                self._trouble = f"the record of this check could not be saved: {error}"
                raise
            else:
                self._trouble = None
                log.info("guard_check_saved", name=self._saved, outcome=check.outcome)
            finally:
                self._changed()

    async def _save_or_tell(self) -> None:
        try:
            await self._save()
        except (Conflict, FieldError, StorageError) as error:
            log.error("guard_check_not_saved", reason=str(error))
