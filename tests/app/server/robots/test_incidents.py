"""Incidents of driving and the measured stops: kept, and stored with their run."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from datetime import UTC, datetime
from typing import Any

import pytest

from app.contract.drive import IncidentEvent, StoppedEvent
from app.contract.values import plain
from app.server import Server
from app.server.robots.incidents import Incidents

from ..servers import begin


def test_incidents_have_wall_clock_times_and_the_newest_twenty_stay() -> None:
    incidents = Incidents(lambda: 100.0, lambda: None)
    for number in range(25):
        incidents.take(IncidentEvent("observer", "fault", f"number {number}", 90.0, None))
    at = incidents.newest[-1].at
    ago = (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds()
    assert ago == pytest.approx(10.0, abs=2.0)
    assert len(incidents.newest) == 20
    assert incidents.newest[-1].sentence == "number 24"


async def test_a_stop_is_stored_in_its_incidents_run_even_after_its_end(
    drive: Any, server: Server
) -> None:
    first = (await begin(server)).id
    now = time.monotonic()
    drive.publish(IncidentEvent(None, "stop", "all robots were stopped", now, 0.3))
    stopped = StoppedEvent(
        "observer", "stop", "all robots were stopped", now, now, now + 0.0124, now + 0.4,
        0.3, 0.3, 0.0612, None,
    )  # fmt: skip
    drive.publish(stopped)
    # Repeated reports, and those of unknown incidents, are ignored.
    drive.publish(replace(stopped, distance_m=5.0))
    drive.publish(replace(stopped, incident_time=now + 1.0))
    await server.runs.stop(first)
    second = (await begin(server)).id
    # This robot stood only after its run was over, and its report is nearly empty.
    late = replace(stopped, role="obstacle", zero_time=None, stood_time=None)
    drive.publish(replace(late, speed_mps=None, distance_m=float("nan")))
    drive.publish(IncidentEvent("observer", "fault", "a wheel stalled", now, None))
    (incident,) = server.driving.facts().incidents[:1]
    assert {role: plain(stop) for role, stop in incident.stops.items()} == {
        "observer": {
            "zero_ms": pytest.approx(12.4),
            "stood_ms": pytest.approx(400.0),
            "distance_m": 0.061,
            "speed_mps": 0.3,
            "separation_m": None,
        },
        "obstacle": dict.fromkeys(plain(incident.stops["observer"])),
    }
    await server.runs.stop(second)
    (kept,) = await server.runs.archive.incidents(first)
    told = {role: asdict(each) for role, each in incident.stops.items()}
    assert {role: asdict(each) for role, each in kept.stops.items()} == told
    (other,) = await server.runs.archive.incidents(second)
    assert (other.sentence, other.stops) == ("a wheel stalled", {})
