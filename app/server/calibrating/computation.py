"""What a worker process computes of a calibration: boards in images, and the fit of views."""

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
    """What a computation gave.

    Attributes:
        names: of the views it rests on.
    """

    fitted: Fitted
    names: tuple[str, ...]


class Computation:
    """At most one job at a time; used in the event loop.

    Attributes:
        progress: of the job that goes on, if one does.
        result: of the newest fit that succeeded. trouble: why the newest one did not.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        """
        Args:
            changed: called whenever one of the attributes is another.
        """
        self._changed = changed
        self._task: asyncio.Task[Result] | None = None
        self.clear()

    def clear(self) -> None:
        """Forget result and trouble; ``cancel`` comes first."""
        self.progress: Progress | None = None
        self.result: CalibrationResult | None = None
        self.trouble: str | None = None

    @property
    def finished(self) -> CalibrationResult:
        """The result.

        Raises:
            Conflict: there is none yet.
        """
        if self.result is None:
            raise Conflict("nothing has been computed yet; capture views, then compute")
        return self.result

    def refuse_going(self) -> None:
        """
        Raises:
            Conflict: a job goes on.
        """
        if self.progress is not None:
            raise Conflict("a calibration is being computed; wait for it, or cancel it")

    def fit(self, job: FitViews) -> None:
        """Begin to fit a calibration to views; ``refuse_going`` comes first."""
        self.trouble = None
        self._begin(job).add_done_callback(partial(self._fitted, job))

    async def find_boards(self, job: FindBoards) -> BoardsFound:
        """Find the boards in images that were sent in.

        It may take minutes, so nothing else has to wait for it: ``cancel`` ends it.

        Raises:
            CalibrationError: the archive cannot be used. Conflict: a job goes on, or it was
                cancelled.
        """
        self.refuse_going()
        try:
            found = await self._begin(job)
        except asyncio.CancelledError:
            caller = asyncio.current_task()
            if caller is not None and caller.cancelling():
                raise
            words = "looking for the board was cancelled; send the images in again"
            raise Conflict(words) from None
        assert isinstance(found, BoardsFound)
        return found

    async def cancel(self) -> None:
        """End the job, if one goes on; an earlier result stays."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.gather(task, return_exceptions=True)

    def _begin(self, job: FitViews | FindBoards) -> asyncio.Task[Result]:
        task = asyncio.create_task(work(job, self._heard), name="compute a calibration")
        # At once, not when the task comes to it: a second request must find it going.
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
            self.trouble = f"computing failed: {type(error).__name__}: {error}"
        self._changed()
