"""Calibration work in a worker process: finding boards in images, and fitting views."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import structlog

from app.runtime.jobs import Progress
from app.server.errors import Conflict
from app.workers.calibration.messages import BoardsFound, FindBoards, Fitted, FitViews, Result
from app.workers.calibration.process import work
from observer.errors import CalibrationError

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class CalibrationResult:
    """Result of a computation.

    Attributes:
        names: names of the views used.
    """

    fitted: Fitted
    names: tuple[str, ...]


class Computation:
    """Runner of at most one job at a time; used in the event loop.

    Attributes:
        progress: progress of the running job, if any.
        result: result of the newest successful fit. trouble: why the newest fit failed.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        """Start without a job.

        Args:
            changed: called whenever an attribute changes.
        """
        self._changed = changed
        self._task: asyncio.Task[Result] | None = None
        self.clear()

    def clear(self) -> None:
        """Clear result and trouble; call ``cancel`` first."""
        self.progress: Progress | None = None
        self.result: CalibrationResult | None = None
        self.trouble: str | None = None

    @property
    def finished(self) -> CalibrationResult:
        """Return the result.

        Raises:
            Conflict: there is no result yet.
        """
        if self.result is None:
            raise Conflict("nothing has been computed yet; capture views, then compute")
        return self.result

    def refuse_going(self) -> None:
        """Refuse to go on while a job runs.

        Raises:
            Conflict: a job is running.
        """
        if self.progress is not None:
            raise Conflict("a calibration is being computed; wait for it, or cancel it")

    def fit(self, job: FitViews) -> None:
        """Start to fit a calibration to views; call ``refuse_going`` first."""
        self.trouble = None
        self._begin(job).add_done_callback(partial(self._fitted, job))

    async def find_boards(self, job: FindBoards) -> BoardsFound:
        """Find the boards in uploaded images.

        This may take minutes; nothing else has to wait, because ``cancel`` ends it.

        Raises:
            CalibrationError: the archive cannot be used. Conflict: a job is running, or this one
                was cancelled.
        """
        self.refuse_going()
        try:
            found = await self._begin(job)
        except asyncio.CancelledError:
            caller = asyncio.current_task()
            if caller is not None and caller.cancelling():
                raise
            words = "board detection was cancelled; upload the images again"
            raise Conflict(words) from None
        assert isinstance(found, BoardsFound)
        return found

    async def cancel(self) -> None:
        """Cancel the running job, if any; keep an earlier result."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.gather(task, return_exceptions=True)

    def _begin(self, job: FitViews | FindBoards) -> asyncio.Task[Result]:
        task = asyncio.create_task(work(job, self._heard), name="compute a calibration")
        # Set at once, not when the task starts: a second request must see that the job is running.
        self._heard(Progress("starting", 0.0))
        task.add_done_callback(self._worked)
        self._task = task
        return task

    def _heard(self, progress: Progress) -> None:
        self.progress = progress
        self._changed()

    def _worked(self, _: asyncio.Task[Result]) -> None:
        self.progress = self._task = None
        self._changed()

    def _fitted(self, job: FitViews, task: asyncio.Task[Result]) -> None:
        if task.cancelled():
            return
        error = task.exception()
        if error is None:
            fitted = task.result()
            assert isinstance(fitted, Fitted)
            self.result = CalibrationResult(fitted, tuple(view.name for view in job.views))
        elif isinstance(error, CalibrationError):
            self.trouble = str(error)
        else:
            log.error("computing_failed", exc_info=error)
            self.trouble = (
                f"the computation failed: internal error ({type(error).__name__}: {error}); see "
                "the server's log"
            )
        self._changed()
