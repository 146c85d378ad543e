"""The command line drives a user's own robot through the real server and drive process."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.drive.supervisor import DriveSupervisor
from app.engine.supervisor import EngineSupervisor
from app.http.server import create_app
from app.settings import Settings
from app.viewer import NullViewer
from observer.robots.contract import RobotPort
from observer.robots.network.client import DemoRobot, ExternalClient, ExternalClientError

PROGRAMME = """
name: short
steps:
  obstacle:
    - {seconds: 1, speed_mps: 0.2, ramp: true}
    - {seconds: 1, speed_mps: 0.2}
    - {seconds: 1, ramp: true}
"""
PERIOD_S = 0.02


class OwnRobot:
    """A simulated robot that connects to ``port`` and obeys its permissions."""

    def __init__(self, port: int) -> None:
        self.client = ExternalClient("127.0.0.1", port, name="Robbie")
        self.robot = DemoRobot()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            robot, permit = self.robot, self.client.permitted()
            robot.step(permit, PERIOD_S)
            try:
                if not self.client.connected:
                    self.client.connect()
                self.client.report(
                    robot.x, robot.y, robot.yaw, robot.speed, robot.turn_rate,
                    enabled=not permit.stop,
                )  # fmt: skip
            except ExternalClientError:
                self._ending.wait(0.05)

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self.client.close()


@pytest.fixture
def own_robot(free_port: int, peer: Any) -> Iterator[OwnRobot]:
    peer.world = "simulated:own"
    port = f"external:127.0.0.1:{free_port}"
    peer.robots = (RobotPort("obstacle", port, "p3dx-sh", "Robbie"),)
    robot = OwnRobot(free_port)
    yield robot
    robot.close()


async def test_a_programme_file_is_driven_and_stopped_by_a_signal(
    own_robot: OwnRobot,
    peer: Any,
    storage: Any,
    tmp_path: Path,
    token: str,
    serve_app: Any,
    eventually: Any,
) -> None:
    (tmp_path / "token").write_text(token)
    (tmp_path / "short.yaml").write_text(PROGRAMME)
    settings = Settings(data=tmp_path)

    def command(port: int, *more: str) -> list[str]:
        server = ["--server", f"http://127.0.0.1:{port}", "--token-file", str(tmp_path / "token")]
        return [sys.executable, "-m", "app.cli", "drive", *more, *server]

    async def started(port: int, *more: str) -> asyncio.subprocess.Process:
        return await asyncio.create_subprocess_exec(
            *command(port, *more), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
        )

    # Used only for its slots; the tests bring their own engine.
    slots = EngineSupervisor()
    app = create_app(
        settings, token, engine=peer, drive=DriveSupervisor(slots.shared_slots),
        storage=storage, viewer=lambda _: NullViewer("not in this test"),
    )  # fmt: skip
    try:
        async with asyncio.timeout(90), serve_app(app, settings) as served:
            await eventually(lambda: own_robot.client.connected, 30)
            process = await started(served.port, str(tmp_path / "short.yaml"), "--json")
            out, err = await process.communicate()
            assert process.returncode == 0, err
            told = json.loads(out)
            assert told["finished"] is True
            driven = told["robots"]["obstacle"]
            # 0.5 + 1 + 0.5 s at 0.2 m/s; the guard limits its acceleration.
            assert own_robot.robot.x == pytest.approx(0.4, abs=0.08)
            assert driven["encoder_distance_m"] == pytest.approx(own_robot.robot.x, abs=0.03)
            assert driven["commanded_distance_m"] == pytest.approx(0.4, abs=0.05)
            facts = (await served.http.get("/api/robots")).json()
            assert facts["robots"]["obstacle"]["state"] == "disarmed"
            assert facts["robots"]["obstacle"]["operator"] is None

            # By name, since it is now kept; in reverse, until the command is interrupted.
            process = await started(served.port, "short", "--reverse")
            await eventually(lambda: own_robot.robot.speed < -0.1, 30)
            process.send_signal(signal.SIGINT)
            await eventually(lambda: own_robot.client.permitted().stop, 0.3)
            _, err = await process.communicate()
            assert process.returncode == 130
            assert b"interrupted; the robots are stopped and disarmed" in err
            await eventually(lambda: own_robot.robot.speed == 0)
    finally:
        await slots.stop()
