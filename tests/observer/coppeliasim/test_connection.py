"""The official client with deadlines: whatever the server does, there is an answer or an error."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from observer.coppeliasim.address import Address
from observer.coppeliasim.connection import (
    Connection,
    CoppeliaSimError,
    CoppeliaSimUnreachable,
)

pytestmark = pytest.mark.usefixtures("extra")

# Seconds: the limit for any error to be reported.
_MOST_S = 2.5


@contextmanager
def _fails_soon(match: str) -> Iterator[None]:
    """Expect a one-sentence error in time, and no hang."""
    started = time.monotonic()
    with pytest.raises(CoppeliaSimError, match=match) as told:
        yield
    assert time.monotonic() - started < _MOST_S
    assert "\n" not in str(told.value)


@contextmanager
def _replying(reply: Callable[[dict[str, Any]], bytes | None]) -> Iterator[Address]:
    """Run a ZeroMQ server that sends the given replies, or none."""
    import cbor
    import zmq

    context = zmq.Context()
    server = context.socket(zmq.REP)
    server.linger = 0
    port = server.bind_to_random_port("tcp://127.0.0.1")
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            if not server.poll(20):
                continue
            answer = reply(cbor.loads(server.recv()))
            if answer is None:
                ended.wait()
            else:
                server.send(answer)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield Address("127.0.0.1", port)
    finally:
        ended.set()
        thread.join()
        server.close()
        context.term()


def test_a_refused_connection_is_reported(free_port: int) -> None:
    with _fails_soon(r"nothing listens at 127\.0\.0\.1:\d+ \(connection refused\); start"):
        Connection(Address("127.0.0.1", free_port))


def test_a_silent_listener_times_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with _fails_soon("did not answer the first call within 1 s"):
            Connection(Address("127.0.0.1", port))


def test_a_server_that_never_replies_times_out() -> None:
    with (
        _replying(lambda _: None) as address,
        _fails_soon("did not answer the first call within 1 s"),
    ):
        Connection(address)


@pytest.mark.parametrize(
    "reply",
    [b"\xff\xff\xff", b"", {"success": True}, {"ret": 5}, [], "text", {"ret": [1]}],
    ids=str,
)
def test_replies_outside_the_protocol_are_refused(reply: Any) -> None:
    import cbor

    encoded = reply if isinstance(reply, bytes) else cbor.dumps(reply)
    with _replying(lambda _: encoded) as address, _fails_soon("does not answer the first call as"):
        Connection(address)


def test_a_server_cannot_call_functions_of_the_main_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import cbor

    called: list[object] = []
    monkeypatch.setattr(sys.modules["__main__"], "harmless", called.append, raising=False)
    asked = cbor.dumps({"func": "harmless", "args": [1]})
    with _replying(lambda _: asked) as address, _fails_soon("does not answer the first call as"):
        Connection(address)
    assert called == []


def test_the_stand_in_speaks_the_documented_protocol(shared: Any) -> None:
    """The documented facts about the real server, checked without its client."""
    import cbor
    import zmq

    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.linger = 0
        client.rcvtimeo = 2000
        client.connect(f"tcp://{shared.address}")

        def ask(**request: Any) -> Any:
            client.send(cbor.dumps(request))
            return cbor.loads(client.recv())

        assert "error" in ask(func="sim.getSimulationTime", args=[])
        assert ask(func="sim.getSimulationTime", args=[], uuid="raw", ver=2) == {"ret": [0.0]}
        info = ask(func="zmqRemoteApi.info", args=["sim"], uuid="raw")["ret"][0]
        assert info["getObject"] == {"func": {}}
        assert info["handle_world"] == {"const": -1}
        assert "No such function" in ask(func="sim.nothing", args=[], uuid="raw")["err"]
        # A step while nothing runs waits once.
        assert ask(func="sim.step", args=[], uuid="raw")["func"] == "_*wait*_"
        assert "ret" in ask(func="_*executed*_", args=[], uuid="raw")
        assert ask(func="_*end*_", args=[], uuid="raw") == {}


def test_a_refused_call_is_reported_and_the_connection_stays_open(shared: Any) -> None:
    with shared.connected() as connection:
        with _fails_soon(
            r"^CoppeliaSim at \S+ refused sim.getObject: "
            r"Object does not exist. \(in function 'sim.getObject'\)$"
        ):
            connection.call("getObject", "/Nothing")
        with _fails_soon("has no function sim.fly"):
            connection.call("fly")
        assert connection.call("getObject", "/PioneerP3DX") >= 0


def test_the_main_module_is_not_modified(shared: Any) -> None:
    with shared.connected():
        assert not hasattr(sys.modules["__main__"], "require")


def test_calls_from_many_threads_get_their_own_replies(shared: Any) -> None:
    answers: list[str] = []
    with shared.connected() as connection:
        handles = [connection.call("getObject", f"/{n}") for n in ("leftCamera", "rightCamera")]
        expected = dict(zip(handles, ("leftCamera", "rightCamera"), strict=True))

        def ask(handle: int) -> None:
            for _ in range(50):
                if connection.call("getObjectAlias", handle) != expected[handle]:
                    answers.append("wrong")

        threads = [threading.Thread(target=ask, args=(h,)) for h in handles * 2]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert answers == []


def test_requests_are_repeated_when_the_server_is_busy(own: Any) -> None:
    running = own("--scene", "empty", "--repeat-every", "3")
    with running.connected() as connection:
        for _ in range(20):
            assert connection.call("getSimulationTimeStep") == 0.05


def test_a_hung_server_closes_the_connection_and_a_new_one_works(bare: Any) -> None:
    connection = Connection(bare.address)
    os.kill(bare.process.pid, signal.SIGSTOP)
    try:
        with _fails_soon("did not answer sim.getSimulationTime within 1 s"):
            connection.call("getSimulationTime")
        assert connection.closed
        with _fails_soon("is closed; reopen it"):
            connection.call("getSimulationTime")
    finally:
        os.kill(bare.process.pid, signal.SIGCONT)
    with bare.connected() as again:
        assert again.call("getSimulationTime") == 0.0


def test_a_server_that_dies_during_a_call_is_reported(own: Any) -> None:
    running = own("--scene", "empty")
    with running.connected() as connection:
        # A step that another client holds up never ends by itself.
        other = Connection(running.address)
        other.call("setStepping", True)
        connection.call("setStepping", True)
        connection.call("startSimulation")
        threading.Timer(0.2, running.process.kill).start()
        with _fails_soon("did not answer sim.step"):
            connection.call("step")
        other._abandon()


def test_the_install_command_is_given_when_the_extra_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name.startswith("coppeliasim") else find(name, *rest),
    )
    with pytest.raises(
        CoppeliaSimUnreachable, match=r"pip install 'dynamic-observer\[coppeliasim\]'"
    ):
        Connection(Address("127.0.0.1", 1))
