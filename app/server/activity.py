"""One change at a time, and what excludes what."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from app.server.errors import Conflict
from app.storage import RunRecord


class Activity:
    """What goes on beside observing: a run or a calibration of cameras, never both.

    Attributes:
        lock: held while source, run, calibration, parameters or rig are changed.
    """

    def __init__(
        self, *, run: Callable[[], RunRecord | None], calibrating: Callable[[], bool]
    ) -> None:
        """
        Args:
            run: the one that is kept. calibrating: whether open cameras are calibrated.
        """
        self.lock = asyncio.Lock()
        self._run = run
        self._calibrating = calibrating

    @property
    def run_id(self) -> str | None:
        """Of the run that is kept."""
        run = self._run()
        return None if run is None else run.id

    def refuse_in_run(self, remedy: str) -> None:
        """
        Raises:
            Conflict: a run is going; the sentence ends with ``remedy``.
        """
        run = self._run()
        if run is not None:
            raise Conflict(f"the run {run.name} is going; {remedy}")

    def refuse_calibrating(self) -> None:
        """
        Raises:
            Conflict: cameras are being calibrated.
        """
        if self._calibrating():
            raise Conflict(
                "a calibration is being made; save it or leave it under Calibration first"
            )
