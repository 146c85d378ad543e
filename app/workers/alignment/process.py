"""The engine's hold of the worker that aligns."""

from __future__ import annotations

from app.runtime.worker import LastingWorker, Worker
from app.workers.alignment.messages import Solve, Solved

# Robots are driven, frames observed and pages served before this.
_WORKER = Worker("app.workers.alignment", 15)
# A solution takes seconds at most, also on a busy machine.
_LONGEST_S = 30.0


class AlignmentWorker(LastingWorker):
    """A process that is started with the first job, and anew where it was lost."""

    def __init__(self) -> None:
        super().__init__(_WORKER, longest_s=_LONGEST_S)

    def solve(self, job: Solve) -> Solved | None:
        """Have it align; see ``LastingWorker.do``."""
        return self.do(job, Solved)
