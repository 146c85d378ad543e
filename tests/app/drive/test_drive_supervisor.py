"""The drive process under its supervisor: replaced when it dies or hangs."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DriveLostEvent,
    DriveStartedEvent,
    DriveState,
    IncidentEvent,
    StopRobots,
    TakeLease,
)
from app.contract.values import plain
from app.drive.supervisor import DriveSupervisor
from app.engine.supervisor import EngineSupervisor
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.supervisor_limits import SupervisorLimits
from app.server.contracts import Drive
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import serve_tcp

PATIENCE_S = 20.0


class Watched:
    """A supervisor and the events that it published."""

    def __init__(self, slots: dict[str, int], **more: Any) -> None:
        self.drive: Drive = DriveSupervisor(slots, **more)
        self.events: list[Any] = []
        self.drive.subscribe(self.events.append)

    async def __aenter__(self) -> Watched:
        await self.drive.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.drive.stop()

    def all(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    async def until(self, found: Callable[[], Any], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not found():
            assert time.monotonic() < deadline, f"{what} did not come: {self.events[-5:]}"
            await asyncio.sleep(0.01)

    def state(self, role: str) -> Any:
        robot = plain(self.all(DriveState)[-1].facts)["robots"][role]
        return None if robot is None else robot["state"]


async def test_the_process_answers_refuses_and_leaks_no_descriptors(slots: dict[str, int]) -> None:
    before = len(os.listdir("/dev/fd"))
    async with Watched(slots) as watched:
        first = [type(event) for event in watched.events[:2]]
        assert first == [DriveStartedEvent, DriveState]
        health = watched.drive.health
        assert (health.generation, health.alive, health.restarts) == (1, True, 0)
        assert health.heartbeat_age_s is not None
        assert health.heartbeat_age_s < 1
        with pytest.raises(ProcessRefused, match="no robot is connected") as refused:
            await watched.drive.request(ArmRobot("observer", None))
        assert refused.value.refusal == "state"
        with pytest.raises(ProcessRefused, match="'nonsense'") as refused:
            await watched.drive.request(ConnectRobot("observer", "nonsense", None, "real"))
        assert refused.value.refusal == "input"
        answer: Any = await watched.drive.request(StopRobots("Ann"))
        assert answer is None
        await watched.until(lambda: watched.all(IncidentEvent), "the incident")
        assert watched.all(IncidentEvent)[0].kind == "stop"
    await watched.drive.stop()
    with pytest.raises(ProcessUnavailable, match="is shutting down"):
        await watched.drive.request(StopRobots("Ann"))
    assert len(os.listdir("/dev/fd")) == before


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
async def test_a_dead_or_hung_process_is_replaced_without_reconnecting(
    slots: dict[str, int], number: signal.Signals
) -> None:
    async def work() -> None:
        robot = serve_tcp(EmulatedRobot("p3dx-sh", now=time.monotonic()))
        with robot:
            async with Watched(slots) as watched:
                await watched.drive.request(ConnectRobot("obstacle", robot.port, None, "real"))
                lease = await watched.drive.request(TakeLease("obstacle", "Ann"))
                await watched.until(lambda: watched.state("obstacle") == "disarmed", "the robot")
                await watched.drive.request(ArmRobot("obstacle", lease))
                pid = watched.drive.health.pid
                assert pid is not None
                started = time.monotonic()
                os.kill(pid, number)
                await watched.until(lambda: watched.all(DriveLostEvent), "the loss")
                lost = time.monotonic() - started
                sys.stdout.write(f"\n{number.name}: known to be lost after {lost:.2f} s\n")
                assert lost < 2.0
                await watched.until(lambda: len(watched.all(DriveStartedEvent)) == 2, "another")
                assert watched.all(DriveLostEvent)[0].reason == (
                    "the drive process ended by SIGKILL"
                    if number == signal.SIGKILL
                    else watched.all(DriveLostEvent)[0].reason
                )


async def test_stopping_the_process_closes_the_robot_connections(slots: dict[str, int]) -> None:
    with serve_tcp(EmulatedRobot("p3dx-sh", now=time.monotonic())) as robot:
        async with Watched(slots) as watched:
            await watched.drive.request(ConnectRobot("obstacle", robot.port, None, "real"))
            await watched.until(lambda: watched.state("obstacle") == "disarmed", "the robot")
            assert robot.robot.is_open
        assert not robot.robot.is_open


async def test_a_process_that_cannot_start_is_given_up(slots: dict[str, int]) -> None:
    limits = SupervisorLimits(standby_delay_s=None, backoff_s=0.01)
    watched = Watched(slots, command=(sys.executable, "-c", "exit(3)"), limits=limits)
    with pytest.raises(ProcessUnavailable, match="drive process ended with exit code 3, 3 ti"):
        await watched.drive.start()


async def test_the_engine_supervisor_provides_the_shared_slots() -> None:
    engine = EngineSupervisor()
    async with Watched(dict(engine.shared_slots)) as watched:
        assert watched.drive.health.alive
    await engine.stop()
