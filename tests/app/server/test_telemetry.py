"""Metrics of the running loop."""

from __future__ import annotations

from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.contract.events import DenseStereoEvent, SkippedFrameEvent
from app.contract.status import DenseStereoStatus
from app.server import Server
from app.server.status import status
from app.server.telemetry import Telemetry


def test_unique_frames_are_counted_once(peer: Any) -> None:
    peer.start_process()
    peer._open(OpenSource("s", None, {}, 0))
    telemetry = Telemetry()
    now = 0.0
    for _ in range(31):
        event = peer.observe()
        telemetry.observed(event, now)
        # The same frame a second time, as when a source delivers it twice.
        telemetry.observed(event, now)
        now += 0.1
    assert telemetry.rate(now) == pytest.approx(10.0, rel=0.1)
    assert telemetry.rate(now + 10) == 0.0
    assert telemetry.frames_observed == 31
    telemetry.new_engine()
    peer.sequence = 0
    telemetry.observed(peer.observe(), now)
    assert telemetry.frames_observed == 32


def dense(frame: int, received: float, trouble: str | None = None) -> DenseStereoEvent:
    return DenseStereoEvent(frame, received, received + 0.04, 0.03, 1, trouble)


def test_clouds_have_a_rate_and_an_age() -> None:
    telemetry = Telemetry()
    assert telemetry.dense(5.0) == DenseStereoStatus(0.0, None, None, None)
    for frame in range(21):
        telemetry.dense_made(dense(frame, 0.1 * frame), 0.1 * frame + 0.05)
    shown = telemetry.dense(2.05)
    assert shown.per_s == pytest.approx(10.0)
    assert (shown.age_s, shown.median_ms, shown.coarseness) == (0.05, 30.0, 1)
    # Nobody watches any more: the newest one only ages.
    shown = telemetry.dense(6.0)
    assert (shown.per_s, shown.age_s, shown.median_ms) == (0.0, 4.0, None)
    telemetry.new_source()
    assert telemetry.dense(6.0).age_s is None


async def test_a_dense_stereo_failure_is_a_warning_until_it_recovers(
    peer: Any, server: Server
) -> None:
    peer.publish(dense(1, 0.1, "dense stereo failed: error: no sense"))
    shown = status(server)
    assert "dense stereo failed: error: no sense" in shown.warnings
    assert shown.dense_stereo.age_s is None
    peer.publish(dense(2, 0.2))
    assert status(server).warnings == []


async def test_what_cannot_be_drawn_is_a_warning_while_it_lasts(peer: Any, server: Server) -> None:
    peer.publish(peer.state(troubles=("drawing the view left failed",)))
    assert "drawing the view left failed" in status(server).warnings
    peer.publish(peer.state())
    assert status(server).warnings == []


def test_percentiles_cover_the_last_samples() -> None:
    telemetry = Telemetry()
    for ms in range(1, 101):
        telemetry.painted(ms / 1000)
    latency = telemetry.latency
    assert (latency.median, latency.p95, latency.count) == (50.5, 95.0, 100)


async def test_skipped_frames_are_reported(peer: Any, server: Server) -> None:
    for index in range(8):
        peer.publish(SkippedFrameEvent(index, "left/0.png is truncated"))
    shown = status(server).skipped
    assert [entry.index for entry in shown] == [3, 4, 5, 6, 7]
