"""Driving at the server: which robots the drive process gets, and what it is told."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.contract.drive import ResetStop, StartGoal, StopRobots, TakeLease
from app.server import NotAvailable, Server
from app.storage import Storage

from ....waiting import until_async
from ..servers import LAB_ROBOTS, started


async def test_a_stop_during_a_reset_holds(drive: Any, server: Server) -> None:
    await until_async(lambda: drive.health.alive)
    await server.driving.stop_robots("Anna")
    request = drive.request

    async def slow(command: Any, timeout_s: float = 1.0) -> Any:
        answer = await request(command, timeout_s)
        if isinstance(command, ResetStop):
            drive.lose()
            with pytest.raises(NotAvailable):
                await server.driving.stop_robots("Bert")
        return answer

    drive.request = slow
    await server.driving.reset("Anna")
    drive.start_process()
    await until_async(lambda: drive.stopped)
    assert drive.stopped.by == "Bert"


async def test_an_undelivered_stop_is_sent_to_the_next_process(drive: Any, server: Server) -> None:
    await until_async(lambda: drive.health.alive)
    drive.lose()
    with pytest.raises(NotAvailable, match="starts in the stopped state"):
        await server.driving.stop_robots("Anna")
    assert not drive.of(StopRobots)
    drive.start_process()
    await until_async(lambda: drive.stopped)
    assert drive.stopped.by == "Anna"
    # Once undone, it is not brought back.
    await server.driving.reset("Anna")
    drive.lose()
    drive.start_process()
    await asyncio.sleep(0.05)
    assert drive.stopped is None


@pytest.mark.parametrize(
    ("watchdog_s", "words"),
    [
        (2.0, "the robots' firmware stops them"),
        (None, "use the robots' own stop switch, as not every robot has reported a watchdog"),
    ],
)
async def test_a_lost_drive_process_is_reported_with_what_stops_the_robots(
    peer: Any, drive: Any, storage: Storage, watchdog_s: float | None, words: str
) -> None:
    drive.watchdog_s = watchdog_s
    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: all(server.driving.facts().robots.values()))
        drive.lose()
        assert words in (server.driving.facts().process.trouble or "")


async def test_the_drive_process_stops_before_the_engine(
    peer: Any, drive: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []

    for name, one in (("drive", drive), ("engine", peer)):
        stop = one.stop

        async def noted(name: str = name, stop: Any = stop) -> None:
            order.append(name)
            await stop()

        monkeypatch.setattr(one, "stop", noted)
    async with started(peer, storage, drive=drive):
        pass
    assert order == ["drive", "engine"]


async def test_a_goal_that_is_lost_with_the_drive_process_says_why_until_the_next_one(
    drive: Any, server: Server
) -> None:
    await until_async(lambda: drive.health.alive)
    lease = await server.driving.ask(TakeLease("observer", "Ann"))
    await server.driving.ask(StartGoal(lease, 3.0, 0.0, 1e-3))
    drive.lose("the drive process was killed")
    for restart in (False, True):
        if restart:
            drive.start_process()
        goal = server.driving.facts().goal
        assert goal is not None
        assert (goal.state, goal.place, goal.path) == ("ended", None, ())
        assert goal.sentence == "The goal was aborted: the drive process was killed."
    lease = await server.driving.ask(TakeLease("observer", "Ann"))
    await server.driving.ask(StartGoal(lease, 2.0, 0.0, 1e-3))
    goal = server.driving.facts().goal
    assert goal is not None
    assert (goal.state, goal.place) == ("driving", (2.0, 0.0))
