"""Both ends of a custom robot's connection, and the wire between them."""

from __future__ import annotations

import json
import selectors
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from observer.robots.network import client as external_client
from observer.robots.network.client import ExternalClient, ExternalClientError
from observer.robots.network.robot import ExternalRobot

from ....waiting import until


def seconds_until(condition: Callable[[], Any]) -> float:
    """Return the seconds until the condition holds."""
    began = time.monotonic()
    until(condition, pause_s=0.001)
    return time.monotonic() - began


def tell(sentence: str) -> None:
    sys.stdout.write(sentence + "\n")


@contextmanager
def reporting(port: int, **more: Any) -> Iterator[ExternalClient]:
    """A client that reports every 20 ms that its robot is at rest."""
    client = ExternalClient("127.0.0.1", port, **more)
    client.connect()
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.02):
            try:
                enabled = not client.permitted().stop
                client.report(0, 0, 0, 0, 0, enabled=enabled, wanted=(0.4, 0.0))
            except ExternalClientError:
                return

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield client
    finally:
        ending.set()
        thread.join()
        client.close()


@contextmanager
def driving(robot: ExternalRobot, client: ExternalClient) -> Iterator[None]:
    """Arm the robot and ask for 0.3 m/s every 20 ms, as the drive loop does."""
    until(lambda: robot.report().received is not None)
    robot.clear()
    robot.enable()
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.02):
            robot.drive(0.3, 0.1)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        until(lambda: client.permitted().speed_mps == 0.3)
        yield
    finally:
        ending.set()
        thread.join()


class Wire:
    """The wire between both ends: forwards their data until it is held back or cut."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.held = threading.Event()
        self._ending = threading.Event()
        self._pair: tuple[socket.socket, ...] = ()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        near, _ = self._listener.accept()
        far = socket.create_connection(("127.0.0.1", self._target))
        self._pair = (near, far)
        with selectors.DefaultSelector() as selector:
            selector.register(near, selectors.EVENT_READ, far)
            selector.register(far, selectors.EVENT_READ, near)
            while not self._ending.is_set():
                if self.held.is_set():
                    time.sleep(0.002)
                    continue
                for key, _ in selector.select(0.005):
                    try:
                        data = key.fileobj.recv(65536)  # type: ignore[union-attr]
                        if not data:
                            return
                        key.data.sendall(data)
                    except OSError:
                        return

    def reset(self) -> None:
        """End both connections without a goodbye, as in a crash."""
        self._ending.set()
        self._thread.join()
        for each in self._pair:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            each.close()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._listener.close()
        for each in self._pair:
            each.close()


class RawRobot:
    """A robot that sends whatever a test wants."""

    HELLO: dict[str, Any] = {  # noqa: RUF012
        "type": "hello", "protocol": 1, "name": "raw", "limits": external_client.LIMITS,
        "outline": external_client.OUTLINE,
    }  # fmt: skip

    def __init__(self, port: int, **changes: Any) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5)
        self.file = self.socket.makefile("rb")
        self.say(**{**self.HELLO, **changes})

    def say(self, **message: Any) -> None:
        self.socket.sendall(json.dumps(message).encode() + b"\n")

    def odometry(self, sequence: int, **changes: Any) -> None:
        message = {
            "type": "odometry", "sequence": sequence, "time": time.monotonic(), "x": 0, "y": 0,
            "yaw": 0, "speed_mps": 0, "turn_rate_radps": 0, "enabled": False, "permit": 0,
        }  # fmt: skip
        self.say(**{**message, **changes})

    def next(self) -> dict[str, Any] | None:
        line = self.file.readline()
        return json.loads(line) if line else None

    def last(self) -> dict[str, Any] | None:
        """Return the last message before the connection ended."""
        last = None
        while (message := self.next()) is not None:
            last = message
        return last

    def close(self) -> None:
        self.file.close()
        self.socket.close()
