"""Rows of speeds from what a worker left of the frames that it observed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from app.server.runs.current_run import speed_rows
from app.storage import SpeedRow
from app.workers.frame_results import read_results

# Frames whose speeds are stored together, so that those of a live run come in between.
_FRAMES_AT_ONCE = 1000


def result_rows(run_id: str, results: Path) -> Iterator[list[SpeedRow]]:
    """Yield the rows of a worker's results, some frames at a time; raises as ``read_results``."""
    found = read_results(results)
    while batch := list(islice(found, _FRAMES_AT_ONCE)):
        yield [
            row
            for each in batch
            for row in speed_rows(run_id, each.line, each.truth, offset_s=each.offset_s)
        ]
