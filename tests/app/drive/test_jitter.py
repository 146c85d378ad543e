"""Lateness computed from hand-made numbers."""

from __future__ import annotations

from app.drive.jitter import Jitter, Lateness


def test_percentiles_cover_only_the_window() -> None:
    jitter = Jitter(window=100)
    assert jitter.lateness() == Lateness(None, None)
    jitter.add(9.0)
    for number in range(100):
        jitter.add(number / 1000)
    lateness = jitter.lateness()
    assert (lateness.p99_ms, lateness.max_ms) == (99.0, 99.0)
    assert jitter.ticks == 101
