"""The reference client of a custom robot."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from observer.robots.contract import RobotPhase, RobotReport
from observer.robots.network import client as external_client
from observer.robots.network.client import ExternalClient, demo
from observer.robots.network.robot import ExternalRobot

from ....waiting import until
from .sides import driving


def test_the_demo_drives_and_reconnects_at_standstill(
    robot: ExternalRobot, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    client = ExternalClient("127.0.0.1", free_port, name="demo")
    thread = threading.Thread(target=demo, args=(client, 2.5, 0.02))
    thread.start()
    until(lambda: robot.report().received is not None)
    with driving(robot, client):
        until(lambda: (robot.report().speed_mps or 0) > 0.25)
        client.close()
        until(lambda: robot.report().fault is not None)
        until(lambda: robot.report().phase is RobotPhase.CONNECTED)
        # It reconnected by itself, and does not move.
        until(lambda: robot.report().speed_mps == 0)
        assert client.permitted().speed_mps == 0
    thread.join()
    report: RobotReport = robot.report()
    assert report.odometry is not None
    assert report.odometry.x > 0.02
    client.close()
    assert "0.3 m/s" in capsys.readouterr().out


def test_the_reference_client_needs_only_python(robot: ExternalRobot, free_port: int) -> None:
    file = Path(external_client.__file__)
    # Isolated and without site-packages, so it cannot import any of our code.
    command = [sys.executable, "-I", "-S", str(file), "--demo", "127.0.0.1", str(free_port)]
    with subprocess.Popen(
        [*command, "--name", "alone"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        until(lambda: robot.report().name == "alone")
        process.kill()
        _, err = process.communicate()
    assert err == b""
    until(lambda: robot.report().phase is RobotPhase.WAITING)
    refused = subprocess.run(
        [*command[:-1], "no"], capture_output=True, text=True, timeout=20, check=False
    )
    assert refused.returncode == 2
    assert "no is not a port" in refused.stderr


@pytest.mark.parametrize(
    "line",
    [
        b'{"type":"permit","sequence":1e999,"time":1,"speed_mps":1,"turn_rate_radps":0,'
        b'"stop":false,"expires_ms":250}',
        b'{"type":"permit","sequence":1,"time":1,"speed_mps":' + b"9" * 400 + b',"turn_rate_radps":'
        b'0,"stop":false,"expires_ms":250}',
        b"[" * 3000,
    ],
)
def test_a_permit_that_cannot_be_read_ends_the_connection(line: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = ExternalClient("127.0.0.1", listener.getsockname()[1])
        connecting = threading.Thread(target=client.connect)
        connecting.start()
        server, _ = listener.accept()
        with server:
            server.sendall(b'{"type":"welcome"}\n')
            connecting.join()
            server.sendall(line + b"\n")
            # A robot reconnects when it is not connected any more.
            until(lambda: not client.connected)
            assert client.permitted().stop
            assert "the connection was lost" in str(client.permitted().reason)
        client.close()
