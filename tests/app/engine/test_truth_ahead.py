"""When a scene's truth is computed: ahead of its frame's turn, but never before a late frame."""

from __future__ import annotations

import time

import pytest

from app.contract.commands import SetPlayback
from app.contract.events import EngineState, ObservationEvent, StateEvent
from observer.truth.contract import TrueBody

from ...waiting import until
from .bench import Bench, StandingTruth, opening


class SlowTruth(StandingTruth):
    """Takes its time, remembers when it began, and may break at a source time."""

    def __init__(self, takes_s: float = 0.0, *, breaks_at: float | None = None) -> None:
        super().__init__()
        self.began: dict[float, float] = {}
        self._takes_s, self._breaks_at = takes_s, breaks_at

    def bodies(self, source_time: float) -> tuple[TrueBody, ...]:
        self.began[source_time] = time.monotonic()
        time.sleep(self._takes_s)
        if source_time == self._breaks_at:
            raise ZeroDivisionError("no rays")
        return super().bodies(source_time)


def test_the_truth_of_a_frame_is_computed_before_its_turn(bench: Bench) -> None:
    bench.truth = truth = StandingTruth()
    bench.value(opening(paused=True))
    bench.value(SetPlayback(step=1))
    # The second frame is read as soon as the first one was observed.
    until(lambda: len(truth.asked) == 2)
    assert len(bench.all(ObservationEvent)) == 1
    bench.value(SetPlayback(step=1))
    event = bench.wait(ObservationEvent, lambda e: e.line["frame"] == 1)
    assert event.truth[0]["position"][0] == truth.asked[1]
    assert truth.asked.count(truth.asked[1]) == 1


@pytest.mark.parametrize(("takes_s", "ahead"), [(0.05, True), (0.3, False)])
def test_only_truth_that_takes_less_than_the_wait_is_computed_ahead(
    bench: Bench, takes_s: float, ahead: bool
) -> None:
    """A late frame is received when it is taken, so what precedes that is in no latency figure."""
    bench.truth = truth = SlowTruth(takes_s)
    bench.value(opening(rate=0.5))
    bench.wait(ObservationEvent, lambda e: e.line["frame"] == 4)
    events = bench.all(ObservationEvent)
    # The first frame is due at once, whatever its truth takes.
    assert truth.began[100.0] > events[0].received
    for event in events[1:]:
        began = truth.began[event.truth[0]["position"][0]]
        assert (began < event.received) is ahead


@pytest.mark.parametrize(
    ("breaks_at", "doing"),
    [(100.0, "observing a frame of"), (100.1, "computing the ground truth of")],
)
def test_truth_that_fails_is_not_reported_as_an_unreadable_source(
    bench: Bench, breaks_at: float, doing: str
) -> None:
    bench.truth = SlowTruth(breaks_at=breaks_at)
    bench.value(opening(rate=0.5))
    failed = bench.wait(StateEvent, lambda s: s.state is EngineState.FAILED)
    assert (failed.reason or "").startswith(f"{doing} numbered failed: ")
