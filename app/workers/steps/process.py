"""Handle through which the server uses the worker that draws steps."""

from __future__ import annotations

from app.runtime.worker import LastingWorker, Worker

# A user waits for it, but driving robots, observing live frames and serving pages take precedence.
_WORKER = Worker("app.workers.steps", 10)
# The first frame of a large folder or of a long video takes a while.
_LONGEST_S = 90.0


def steps_worker() -> LastingWorker:
    """Return a worker that has not been started yet."""
    return LastingWorker(_WORKER, longest_s=_LONGEST_S)
