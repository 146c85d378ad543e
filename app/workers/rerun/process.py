"""Handle through which the server uses the re-run worker."""

from __future__ import annotations

from collections.abc import Callable

from app.runtime.jobs import Progress
from app.runtime.worker import Worker
from app.workers.rerun.messages import Rerun, Rerunned

# Driving robots, observing live frames and serving pages take precedence.
_WORKER = Worker("app.workers.rerun", 15)


async def rerun_in_worker(
    job: Rerun, progress: Callable[[Progress], None], held: Callable[[], bool]
) -> Rerunned:
    """Run a job in a worker; cancelling ends the worker.

    Args:
        progress: called in the event loop on every progress report.
        held: as for ``Worker.do``.

    Raises:
        JobFailed: the recording cannot be re-run; one sentence says why.
    """
    done: Rerunned = await _WORKER.do(job, progress, held=held)
    return done
