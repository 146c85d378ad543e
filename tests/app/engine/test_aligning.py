"""Which alignment is in force, as solutions come from the worker."""

from __future__ import annotations

import time
from typing import cast

from app.engine.aligning import AlignmentThread
from app.workers.alignment.messages import Choices, Solve, Solved
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.truth.alignment.result import Alignment
from observer.truth.alignment.time_offset import TimeOffset
from observer.truth.live.clock import ClockFit

from ...waiting import until


class ScriptedWorker:
    """Finds what it is told to find: offset, its deviation, and the overlap; None refuses."""

    def __init__(self, found: list[tuple[float, float, float] | None]) -> None:
        self.found = found
        self.jobs: list[Solve] = []

    def solve(self, job: Solve) -> Solved | None:
        self.jobs.append(job)
        what = self.found.pop(0) if self.found else None
        if what is None:
            return Solved("not aligned yet: nothing moves", 0.0)
        offset, sigma, overlap = what
        time_ = TimeOffset(offset, sigma, 0.0, 0.0, None, 0.95, None, overlap, 0.01, 100)
        alignment = Alignment(
            time_, {"Amigo": "observer"}, (), {}, None, Pose.identity(), {}, {}, ()
        )
        return Solved(alignment, 0.0)

    def end(self) -> None:
        pass

    def close(self) -> None:
        pass


def empty_line(at: float) -> ObservationLine:
    return cast(ObservationLine, {"time": at, "segment": 0, "pose": None, "obstacles": []})


def test_a_known_delay_is_not_replaced_by_a_few_seconds_of_data() -> None:
    found = [
        (0.10, 0.01, 10.0), (0.70, 0.01, 5.0), None, (0.12, 0.01, 8.0), (0.40, 0.01, 30.0),
    ]  # fmt: skip
    worker = ScriptedWorker(list(found))
    fit = ClockFit(0.0, None, 0.0, 10, 0.0, 1.0)
    aligner = AlignmentThread(list, lambda: fit, lambda: worker, rest_s=0.0)
    held: list[float] = []
    try:
        aligner.begin(1, Choices(), carry=False)
        now = 0.0
        while len(worker.jobs) < len(found):
            aligner.observed(empty_line(now), now + 0.01)
            now += 0.1
            time.sleep(0.01)
            aligned = aligner.aligned
            offset = None if aligned is None else aligned.alignment.time.offset_s
            if offset is not None and (not held or held[-1] != offset):
                held.append(offset)
        until(lambda: aligner.aligned.alignment.time.offset_s == 0.40, "the last one holds")
        assert held in ([0.10, 0.12], [0.10, 0.12, 0.40])
        # The same source reopened: the same delay, but the world frame is new.
        aligner.begin(2, Choices(), carry=True)
        for _ in range(15):
            aligner.observed(empty_line(now), now + 0.01)
            now += 0.1
        carried = until(
            lambda: aligner.aligned and aligner.aligned.session == 2 and aligner.aligned, "carried"
        )
        assert carried.carried
        assert carried.alignment.time.offset_s == 0.40
        assert worker.jobs[-1].anew
        # Another source: nothing of the old alignment applies.
        aligner.begin(3, Choices(), carry=False)
        until(lambda: aligner.aligned is None, "forgotten")
        assert aligner.sentence.startswith("not aligned yet: ")
    finally:
        aligner.end()
        aligner.join(5.0)
