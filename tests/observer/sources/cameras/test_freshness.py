"""Which frames waited in a queue, by their stamps alone."""

from __future__ import annotations

import pytest

from observer.sources.cameras.freshness import Waiting

PERIOD_S = 0.04
TRANSFER_S = 0.03


@pytest.fixture
def waiting() -> Waiting:
    """After a first frame that did not wait."""
    waiting = Waiting()
    assert waiting.add(10.0 + TRANSFER_S, 10.0, PERIOD_S) == (10.0 + TRANSFER_S, False)
    return waiting


def test_a_frame_counts_as_received_when_it_would_have_come_without_waiting(
    waiting: Waiting,
) -> None:
    received, skip = waiting.add(10.1, 10.0 + PERIOD_S, PERIOD_S)
    assert received == pytest.approx(10.0 + PERIOD_S + TRANSFER_S)
    assert not skip


def test_queued_frames_are_skipped_until_one_comes_in_time(waiting: Waiting) -> None:
    for n in (1, 2, 3, 4):
        assert waiting.add(11.0, 10.0 + n * PERIOD_S, PERIOD_S)[1]
    received, skip = waiting.add(11.0 + TRANSFER_S, 11.0, PERIOD_S)
    assert received == pytest.approx(11.0 + TRANSFER_S)
    assert not skip
    assert waiting.add(12.0, 11.0 + PERIOD_S, PERIOD_S)[1]


@pytest.mark.parametrize("behind_s", [0.5, 1.9])
def test_frames_that_are_always_late_are_delivered_as_late_as_they_are(behind_s: float) -> None:
    waiting = Waiting()
    for n in range(20):
        arrival = 10.0 + n * PERIOD_S
        received, skip = waiting.add(arrival, arrival - behind_s, PERIOD_S)
        assert arrival - received == pytest.approx(behind_s - 0.1)
        assert skip == (n < 4)
