"""Handle through which the server uses the worker that compares methods."""

from __future__ import annotations

from collections.abc import Callable

from app.runtime.jobs import Progress
from app.runtime.worker import Worker
from app.workers.methods.messages import Compared, CompareMethods

# Driving robots, observing live frames and serving pages take precedence.
_WORKER = Worker("app.workers.methods", 15)


async def compare_in_worker(
    job: CompareMethods, progress: Callable[[Progress], None], held: Callable[[], bool]
) -> Compared:
    """Run a job in a worker; cancelling ends the worker.

    Args:
        progress: called in the event loop on every progress report.
        held: as for ``Worker.do``.

    Raises:
        JobFailed: the frames cannot be observed; one sentence says why.
    """
    done: Compared = await _WORKER.do(job, progress, held=held)
    return done
