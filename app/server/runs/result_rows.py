"""Speed rows made from a worker's per-frame results."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from app.server.runs.current_run import speed_rows
from app.storage import SpeedRow
from app.workers.frame_results import read_results

# Frames stored in one write; writes of a live run can come in between.
_FRAMES_AT_ONCE = 1000


def result_rows(run_id: str, results: Path) -> Iterator[list[SpeedRow]]:
    """Yield the rows of a worker's results, some frames at a time; raise as ``read_results``."""
    found = read_results(results)
    while batch := list(islice(found, _FRAMES_AT_ONCE)):
        yield [row for each in batch for row in speed_rows(run_id, each)]
