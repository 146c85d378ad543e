"""Handle through which the engine uses the alignment worker."""

from __future__ import annotations

from app.runtime.worker import LastingWorker, Worker
from app.workers.alignment.messages import Solve, Solved

# Driving robots, observing frames and serving pages take precedence.
_WORKER = Worker("app.workers.alignment", 15)
# A solution takes seconds at most, even on a busy machine.
_LONGEST_S = 30.0


class AlignmentWorker(LastingWorker):
    """Alignment process that starts with the first job, and again whenever it is lost."""

    def __init__(self) -> None:
        super().__init__(_WORKER, longest_s=_LONGEST_S)

    def solve(self, job: Solve) -> Solved | None:
        """Send it a job and wait for the result; see ``LastingWorker.do``."""
        return self.do(job, Solved)
