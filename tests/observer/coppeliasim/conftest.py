"""A CoppeliaSim stand-in that runs as a process; tests talk to it through the real client."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from observer.coppeliasim.address import Address
from observer.coppeliasim.connection import Connection

from .reading import wait_until_stopped

_STAND_IN = Path(__file__).with_name("stand_in.py")


@pytest.fixture(scope="session")
def extra() -> None:
    """Skip a test, and say why, where the extra is not installed."""
    if importlib.util.find_spec("coppeliasim_zmqremoteapi_client") is None:
        pytest.skip("needs CoppeliaSim's client: pip install 'dynamic-observer[coppeliasim]'")


class StandIn:
    """A running stand-in."""

    def __init__(self, *options: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(_STAND_IN), *options], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the stand-in did not start"
        self.address = Address("127.0.0.1", int(line))
        self.spec = self.address.world

    @contextmanager
    def connected(self) -> Iterator[Connection]:
        connection = Connection(self.address)
        try:
            yield connection
        finally:
            connection.close()

    def end(self) -> None:
        self.process.kill()
        self.process.wait(10)
        assert self.process.stdout is not None
        self.process.stdout.close()


@contextmanager
def stand_in(*options: str) -> Iterator[StandIn]:
    running = StandIn(*options)
    try:
        yield running
    finally:
        running.end()


@pytest.fixture(scope="session")
def shared() -> Iterator[StandIn]:
    """A stand-in with the lab's scene, for tests that leave it as they found it."""
    with stand_in("--scene", "lab") as running:
        yield running


@pytest.fixture
def own() -> Iterator[Callable[..., StandIn]]:
    """Start a stand-in that the test may use as it likes."""
    started: list[StandIn] = []

    def start(*options: str) -> StandIn:
        started.append(StandIn(*options))
        return started[-1]

    yield start
    for each in started:
        each.end()


@pytest.fixture(scope="session")
def _bare_process() -> Iterator[StandIn]:
    with stand_in("--scene", "empty") as running:
        yield running


@pytest.fixture
def bare(_bare_process: StandIn) -> StandIn:
    """A stand-in with an empty scene to fill; the test must not kill it."""
    with _bare_process.connected() as connection:
        connection.call("stopSimulation")
        wait_until_stopped(connection)
        scene, every = connection.constant("handle_scene"), connection.constant("handle_all")
        left = connection.call("getObjectsInTree", scene, every, 0)
        if left:
            connection.call("removeObjects", left)
    return _bare_process
