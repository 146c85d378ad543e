"""Supply of robots and guard parameters to the drive process."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.contract.drive import ConnectRobot, DisconnectRobot, SetGuard
from app.contract.events import EngineState, StateEvent
from app.server.robots.connecting import wanted_robots
from app.server.status import status
from app.storage import Storage
from observer.navigation.parameters import AllParameters
from observer.rig.rig import Rig

from ....waiting import until_async
from ..servers import LAB_ROBOTS, started

RIG = Rig(ports={"observer": "/dev/ttyUSB0"}, models={"observer": "amigo-sh", "obstacle": "p3dx"})


def shows(world: str | None, robots: Any = ()) -> StateEvent:
    return StateEvent(EngineState.PREVIEW, None, world=world, robots=robots)


def test_robots_belong_to_the_observed_world() -> None:
    assert wanted_robots(shows("simulated:lab/1", LAB_ROBOTS), RIG) == {
        "observer": ConnectRobot(
            "observer", "socket://127.0.0.1:5001", "amigo-sh", "simulated:lab/1", "the observer"
        ),
        "obstacle": ConnectRobot(
            "obstacle", "socket://127.0.0.1:5002", "p3dx-sh", "simulated:lab/1", "the obstacle"
        ),
    }
    assert wanted_robots(shows("real"), RIG) == {
        "observer": ConnectRobot("observer", "/dev/ttyUSB0", "amigo-sh", "real")
    }
    # A world without robots, and a recording: neither drives the real robot.
    assert wanted_robots(shows("simulated:lab/1"), RIG) == {}
    assert wanted_robots(shows(None), RIG) == {}
    assert wanted_robots(shows(None, LAB_ROBOTS), RIG) == {}


async def test_each_source_brings_its_own_robots(peer: Any, drive: Any, storage: Storage) -> None:
    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.robots) == 2)
        server.rig.rig = RIG
        peer.world, peer.robots = "real", ()
        await server.source.open("camera:0,1", None)
        await until_async(lambda: set(drive.robots) == {"observer"})
        assert drive.robots["observer"].port == "/dev/ttyUSB0"
        peer.world = None
        await server.source.open("recorded", None)
        await until_async(lambda: not drive.robots)
        assert {c.role for c in drive.of(DisconnectRobot)} == {"observer", "obstacle"}
        # Nothing is repeated.
        told = len(drive.commands)
        peer.publish(peer.state())
        await asyncio.sleep(0.05)
        assert len(drive.commands) == told


async def test_a_lost_engine_keeps_the_robots_until_the_next_engine(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    async with started(peer, storage, drive=drive):
        await until_async(lambda: len(drive.robots) == 2)
        peer.lose()
        await asyncio.sleep(0.02)
        assert not drive.of(DisconnectRobot)
        peer.world = "simulated:lab/2"
        peer.start_process()
        await until_async(lambda: drive.robots["obstacle"].world == "simulated:lab/2")
        assert len(drive.of(ConnectRobot)) == 4


async def test_guard_parameters_are_sent_first_and_on_every_change(
    peer: Any, drive: Any, storage: Storage
) -> None:
    names = [name for name in AllParameters().flat() if name.startswith("guard.")]
    assert names

    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.robots) == 2)
        assert isinstance(drive.commands[0], SetGuard)
        assert sorted(drive.commands[0].parameters) == sorted(names)
        await server.parameters.change({"guard.speed_max_mps": 0.4})
        await until_async(lambda: len(drive.of(SetGuard)) == 2)
        assert drive.of(SetGuard)[1].parameters["guard.speed_max_mps"] == 0.4
        # Other parameters do not concern the drive process.
        await server.parameters.change({"ego_motion.ransac_threshold_px": 2.0})
        drive.lose()
        drive.start_process()
        await until_async(lambda: len(drive.robots) == 2)
        assert len(drive.of(SetGuard)) == 3
        assert drive.of(SetGuard)[2] == drive.of(SetGuard)[1]
        drive.refuse[SetGuard] = ("input", "guard.speed_max_mps is too high")
        await server.parameters.change({"guard.speed_max_mps": 0.5})
        await until_async(lambda: server.driving.warnings)
        assert server.driving.warnings == ["guard.speed_max_mps is too high"]


async def test_a_refused_connection_is_reported_and_not_retried(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    drive.refuse[ConnectRobot] = ("input", "nothing answers there")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(server.driving.warnings) == 2)
        warnings = status(server).warnings
        assert "the obstacle is not connected: nothing answers there" in warnings
        trouble = server.driving.facts().trouble
        assert trouble["observer"] == "the observer is not connected: nothing answers there"
        told = len(drive.of(ConnectRobot))
        await asyncio.sleep(0.1)
        assert told == len(drive.of(ConnectRobot)) == 2
        drive.refuse.clear()
        # The robots of another source are a new request.
        peer.world = "simulated:lab/2"
        await server.source.open("simulated:other", None)
        await until_async(lambda: len(drive.robots) == 2)
        assert server.driving.warnings == []


async def test_an_unresponsive_robot_is_retried(
    peer: Any, drive: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.server.robots.connecting._RETRY_S", 0.02)

    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    drive.refuse[ConnectRobot] = ("failure", "the port is busy")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.of(ConnectRobot)) > 5)
        assert "the port is busy" in server.driving.warnings[0]
        drive.refuse.clear()
        await until_async(lambda: len(drive.robots) == 2)
        assert server.driving.warnings == []


async def test_an_unresponsive_robot_is_disconnected_when_no_longer_wanted(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", LAB_ROBOTS
    drive.refuse[ConnectRobot] = ("failure", "it took too long")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(server.driving.warnings) == 2)
        assert not drive.of(DisconnectRobot)
        peer.world, peer.robots = None, ()
        await server.source.open("simulated:other", None)
        # It may be connected by now, so it is disconnected in any case.
        await until_async(lambda: len(drive.of(DisconnectRobot)) == 2)
        await until_async(lambda: server.driving.warnings == [])
