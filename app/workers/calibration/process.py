"""Handle through which the server uses the calibration worker."""

from __future__ import annotations

from collections.abc import Callable

from app.runtime.jobs import Progress
from app.runtime.worker import JobFailed, Worker
from app.workers.calibration.messages import Job, Result
from observer.errors import CalibrationError

# An image larger than any camera's is not decoded: a few bytes could fill all memory.
_MOST_PIXELS = 60_000_000
# The engine's loop and the server take precedence.
_WORKER = Worker("app.workers.calibration", 5, {"OPENCV_IO_MAX_IMAGE_PIXELS": str(_MOST_PIXELS)})


async def work(job: Job, progress: Callable[[Progress], None]) -> Result:
    """Run a job in a worker; cancelling ends the worker.

    Args:
        progress: called in the event loop on every progress report.

    Raises:
        CalibrationError: the job cannot be done; one sentence says why.
    """
    try:
        result: Result = await _WORKER.do(job, progress)
    except JobFailed as error:
        raise CalibrationError(str(error)) from error
    return result
