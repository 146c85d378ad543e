"""A stand-in for CoppeliaSim: its remote API server's protocol 2 over ZeroMQ, as a process.

It follows the add-on "ZMQ remote API server" of CoppeliaSim 4.6 and newer: one REP socket, CBOR,
clients identified by uuid and forgotten when silent, one coroutine per client, `_*wait*_` and
`_*executed*_` during a step, a counter of nested stepping, `_*repeat*_` when busy, `_*end*_`,
errors prefixed with their place in Lua, and empty tables that may be either an array or a map.

    python stand_in.py [--scene lab|empty] [--repeat-every N]    prints its port
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

import cbor
import zmq
from stand_in_functions import Functions
from stand_in_scene import (
    ABOUT_TO_STOP,
    CONSTANTS,
    PAUSED,
    RUNNING,
    STOPPED,
    Refused,
    Scene,
)

_STANDING = (STOPPED, PAUSED)
Coroutine = Generator[None, None, None]


@dataclass
class Client:
    """One client, until it is forgotten."""

    uuid: str
    timeout: float
    idle_since: float
    desired_step: int
    stepping: int = 0
    request: dict[str, Any] = field(default_factory=dict)
    coroutine: Coroutine | None = None


class Server:
    """The add-on and the simulator's main loop that calls it."""

    def __init__(self, functions: Functions, port: int, repeat_every: int) -> None:
        self._functions = functions
        self._scene: Scene = functions.scene
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.linger = 0
        if port:
            self._socket.bind(f"tcp://127.0.0.1:{port}")
            self.port = port
        else:
            self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._clients: dict[str, Client] = {}
        self._client: Client | None = None
        self._current_step = 0
        self._repeat_every = repeat_every
        self._received = 0

    def run(self) -> None:
        """Run forever."""
        while True:
            if self._scene.state == ABOUT_TO_STOP:
                # sysCall_afterSimulation
                self._scene.stop()
                self._current_step = 0
            if self._scene.state in _STANDING:
                self._handle_queue(0.02)
                continue
            ends = time.monotonic() + self._scene.time_step
            # sysCall_actuation: wait for the clients that step.
            while True:
                self._handle_queue(0.001)
                waits = [c for c in self._clients.values() if c.stepping > 0]
                if not any(c.desired_step <= self._current_step for c in waits):
                    break
                if self._scene.state != RUNNING:
                    break
            if self._scene.state != RUNNING:
                continue
            self._current_step += 1
            self._scene.advance()
            # When no client steps, it runs in real time.
            while not waits and time.monotonic() < ends:
                self._handle_queue(0.001)
                waits = [c for c in self._clients.values() if c.stepping > 0]

    # ------------------------------------------------------------------ the queue

    def _handle_queue(self, wait_s: float) -> None:
        now = time.monotonic()
        for client in list(self._clients.values()):
            if now - client.idle_since > client.timeout:
                del self._clients[client.uuid]
        while self._socket.poll(int(wait_s * 1000)):
            self._handle(cbor.loads(self._socket.recv()))
            wait_s = 0.0

    def _handle(self, request: dict[str, Any]) -> None:
        uuid = request.get("uuid")
        if uuid is None:
            told = "The client ZeroMQ remote API version does not match CoppeliaSim's version"
            self._socket.send(cbor.dumps({"success": False, "error": told}))
            return
        if request.get("func") == "_*end*_":
            self._clients.pop(uuid, None)
            self._socket.send(cbor.dumps({}))
            return
        self._received += 1
        executed = request.get("func") == "_*executed*_"
        if self._repeat_every and self._received % self._repeat_every == 0 and not executed:
            self._socket.send(cbor.dumps({"func": "_*repeat*_", "args": {}}))
            return
        client = self._clients.get(uuid)
        if client is None:
            client = self._clients[uuid] = Client(
                uuid, request.get("timeout", 600.0), time.monotonic(), self._current_step
            )
            client.coroutine = self._serve(client)
        client.request = request
        self._client = client
        assert client.coroutine is not None
        next(client.coroutine)
        client.idle_since = time.monotonic()

    def _send(self, reply: dict[str, Any]) -> None:
        assert self._client is not None
        self._client.idle_since = time.monotonic()
        self._socket.send(cbor.dumps(_as_lua(reply)))

    def _serve(self, client: Client) -> Coroutine:
        while True:
            reply: dict[str, Any] = {}
            try:
                reply["ret"] = yield from self._answer(client)
            except Refused as refused:
                where = '[string "ZMQ remote API server@addOnScript"]:271: '
                reply = {"err": f"{where}{refused}_=NL=_stack traceback:_=NL=_\t[C]: in function"}
            self._send(reply)
            yield

    def _answer(self, client: Client) -> Generator[None, None, list[Any]]:
        name = client.request["func"]
        arguments = client.request.get("args") or []
        arguments = [None if a == "_*NIL*_" else a for a in arguments]
        if name == "zmqRemoteApi.require":
            return []
        if name == "zmqRemoteApi.info":
            functions: dict[str, Any] = {
                f: {"func": {}} for f in [*self._functions.names(), *_OF_THE_SERVER]
            }
            return [functions | {c: {"const": value} for c, value in CONSTANTS.items()}]
        space, _, function = name.partition(".")
        if function == "setStepping":
            return [self._set_stepping(client, arguments[0])]
        if function == "step":
            yield from self._step(client)
            return []
        if function == "stopSimulation":
            for each in self._clients.values():
                each.stepping, each.desired_step = 0, self._current_step + 10
        called = self._functions.find(function) if space == "sim" else None
        if called is None:
            raise Refused(f"No such function: {name}")
        result = called(*arguments)
        return list(result) if isinstance(result, tuple) else [] if result is None else [result]

    def _set_stepping(self, client: Client, enabled: bool) -> int:
        before = client.stepping
        if enabled:
            if before == 0:
                client.desired_step = self._current_step
            client.stepping += 1
        elif before > 0:
            client.stepping -= 1
        return before

    def _step(self, client: Client) -> Coroutine:
        running = self._scene.state not in _STANDING
        if running and client.stepping > 0:
            client.desired_step = self._current_step + 1
        before = self._current_step
        while before == self._current_step:
            self._send({"func": "_*wait*_", "args": {}})
            yield
            assert client.request["func"] == "_*executed*_", client.request
            if not running:
                break


_OF_THE_SERVER = ("setStepping", "step")


def _as_lua(value: Any) -> Any:
    """Lua has one kind of empty table, so an empty list becomes an empty map."""
    if isinstance(value, list | tuple):
        return [_as_lua(each) for each in value] or {}
    if isinstance(value, dict):
        return {key: _as_lua(each) for key, each in value.items()}
    return value


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--scene", choices=("lab", "empty"), default="lab")
    arguments.add_argument("--port", type=int, default=0)
    arguments.add_argument("--repeat-every", type=int, default=0)
    given = arguments.parse_args()
    functions = Functions(given.scene)
    server = Server(functions, given.port, given.repeat_every)
    sys.stdout.write(f"{server.port}\n")
    sys.stdout.flush()
    try:
        server.run()
    except KeyboardInterrupt:
        sys.exit(0)


if __name__ == "__main__":
    main()
