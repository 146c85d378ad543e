"""Speeds sent to the wheels and measured there: numbered, and stored with a run."""

from __future__ import annotations

import asyncio
from typing import Any

from app.contract.drive import WheelSpeedEvent
from app.server import Server
from app.server.robots.wheels import WheelLog
from app.server.runs.current_run import speed_rows, wheel_rows
from app.server.source_time import SourceInstant
from app.storage import Storage
from app.workers.frame_results import frame_result

from ..servers import begin, started


def test_the_newest_samples_are_numbered_and_kept() -> None:
    log = WheelLog()
    for number in range(501):
        event = WheelSpeedEvent("observer", float(number), 0.3, 0.25)
        assert log.take(event, None) is None
        sample = log.take(event, SourceInstant(41.0 + number, 2, 1))
    assert sample is not None
    rows = list(wheel_rows("run", sample))
    assert [(row.source, row.speed, row.segment, row.track_id) for row in rows] == [
        ("commanded", 0.3, 2, None),
        ("encoder", 0.25, 2, None),
    ]
    assert log.newest == 501
    assert [each.number for each in log.since(499)] == [500, 501]
    assert len(log.since(0)) == 200


async def test_a_driven_roles_command_is_written_once(
    peer: Any, drive: Any, storage: Storage
) -> None:
    async with started(peer, storage, drive=drive):
        event = peer.observe()
    seen = frame_result(event.line, event.truth)
    assert "commanded" in {row.source for row in speed_rows("run", seen)}
    assert "commanded" not in {row.source for row in speed_rows("run", seen, ["obstacle"])}
    assert "commanded" in {row.source for row in speed_rows("run", seen, ["observer"])}


async def test_wheel_speeds_are_stored_while_no_frames_arrive(
    peer: Any, drive: Any, storage: Storage, server: Server
) -> None:
    record = await begin(server)
    peer.observe()
    # Of a live source, whose clock goes on.
    server.source.time.live = True
    told = 0
    while not any(row.source == "encoder" for row in storage.speeds(record.id)):
        drive.measure("observer", 0.3, 0.25)
        told += 1
        await asyncio.sleep(0.02)
    assert told > 1
