"""A connection to a simulator through its own client, with a deadline for every call.

The client itself waits for an answer forever. A call that misses its deadline leaves the client
unusable (a request without its reply), so the connection is closed and a new one must be opened.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
import socket
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from observer.coppeliasim.address import Address
from observer.errors import SourceError
from observer.extras import package_missing
from observer.geometry import Float64Array

# Seconds for a whole call; shorter than the time after which a silent engine counts as hung.
ANSWER_WITHIN_S = 1.0
CONNECT_WITHIN_S = 1.0
# Seconds: the simulator forgets a client that is silent for this long. A client that dies while
# stepping blocks it for that time, so it is short, and a stepping client calls in between.
FORGOTTEN_AFTER_S = 1.0
# What the server may ask, in protocol 2, of a client that offers no callbacks.
_SERVER_ASKS = ("_*wait*_", "_*repeat*_")
_WHERE = re.compile(r'^\[string "[^"]*"\]:\d+:\s*')
_LUA_NEWLINE = "_=NL=_"
_MISSING = object()


class CoppeliaSimError(SourceError):
    """The simulator refused a call, or its scene is unsuitable."""


class CoppeliaSimUnreachable(CoppeliaSimError):
    """The simulator does not answer or violates the protocol; the connection is closed."""


class _NoAnswer(Exception):
    """The deadline passed."""


class _NotTheProtocol(Exception):
    """The answer is not one of protocol 2."""


class Connection:
    """A connection to one simulator. Calls from several threads are serialised.

    Raises:
        CoppeliaSimUnreachable: the extra is not installed, nothing listens there, or what listens
            does not answer like CoppeliaSim.
    """

    def __init__(self, address: Address) -> None:
        self.address = address
        self._lock = threading.RLock()
        self._deadline = 0.0
        self._client: Any = None
        self._sim: Any = None
        self.last_call = time.monotonic()
        _check_installed()
        _check_listening(address)
        self._client = _new_client(address)
        receive = self._client._recv
        self._client._recv = lambda: self._received(receive)
        try:
            self._sim = self._answered(
                "the first call", ANSWER_WITHIN_S, self._client.require, "sim"
            )
        except CoppeliaSimError:
            self.close()
            raise

    @property
    def closed(self) -> bool:
        return self._client is None

    def call(self, function: str, *arguments: Any, within_s: float = ANSWER_WITHIN_S) -> Any:
        """Call ``sim.FUNCTION(*arguments)``; return None, a value or a tuple.

        Raises:
            CoppeliaSimError: the simulator refused it.
            CoppeliaSimUnreachable: it did not answer in time; the connection is closed.
        """
        with self._lock:
            if self._client is None:
                raise CoppeliaSimUnreachable(
                    f"the connection to CoppeliaSim at {self.address} is closed; reopen it"
                )
            called = getattr(self._sim, function, None)
            if not callable(called):
                raise CoppeliaSimError(
                    f"CoppeliaSim at {self.address} has no function sim.{function}; "
                    f"version 4.6 or newer is needed"
                )
            return self._answered(f"sim.{function}", within_s, called, *arguments)

    def number(self, function: str, *arguments: Any) -> float:
        """Call a function that returns one number.

        Raises:
            CoppeliaSimError: as in ``call``, or the answer is not a finite number.
        """
        return float(self.finite([self.call(function, *arguments)], 1)[0])

    def finite(self, given: object, count: int) -> Float64Array:
        """Convert the simulator's answer to (count,) float64.

        Raises:
            CoppeliaSimError: it does not consist of ``count`` finite numbers.
        """
        if isinstance(given, Sequence) and len(given) == count:
            with contextlib.suppress(TypeError, ValueError):
                values = np.array(given, dtype=np.float64)
                if np.isfinite(values).all():
                    return values
        raise CoppeliaSimError(
            f"CoppeliaSim at {self.address} returned {str(given)[:80]} where {count} numbers are "
            "expected"
        )

    def objects(self, kind: str, root: int | None = None, options: int = 0) -> list[int]:
        """Return the handles of all objects of a kind, such as ``joint``, below ``root``.

        Args:
            root: None for the whole scene.
            options: of ``sim.getObjectsInTree``; 1 excludes ``root`` itself.
        """
        number = self.constant(f"sceneobject_{kind}", f"object_{kind}_type")
        root = self.constant("handle_scene") if root is None else root
        found = self.call("getObjectsInTree", root, number, options)
        # Lua has only one kind of table, so an empty list may arrive as an empty map.
        return [int(handle) for handle in found] if isinstance(found, list | tuple) else []

    def constant(self, *names: str) -> int:
        """Return the first of these constants of ``sim`` that exists in this version.

        Raises:
            CoppeliaSimError: it has none of them.
        """
        for name in names:
            value = getattr(self._sim, name, None)
            if isinstance(value, int):
                return value
        raise CoppeliaSimError(
            f"CoppeliaSim at {self.address} has no constant sim.{names[0]}; "
            f"version 4.6 or newer is needed"
        )

    def has(self, function: str) -> bool:
        """True if this version has a function with this name."""
        return callable(getattr(self._sim, function, None))

    def close(self) -> None:
        """Say goodbye if the simulator listens, and release the socket; safe to call twice."""
        with self._lock:
            client = self._client
            if client is None:
                return
            # After an unfinished call, or a first call that failed, there is no goodbye.
            if self._sim is not None:
                with contextlib.suppress(Exception):
                    self._deadline = time.monotonic() + ANSWER_WITHIN_S
                    client._send({"func": "_*end*_", "args": []})
                    client._recv()
            self._abandon()

    def _answered(self, what: str, within_s: float, called: Any, *arguments: Any) -> Any:
        self._deadline = time.monotonic() + within_s
        try:
            return called(*arguments)
        except _NoAnswer:
            self._abandon()
            raise CoppeliaSimUnreachable(
                f"CoppeliaSim at {self.address} did not answer {what} within {within_s:g} s; check "
                "that it is running and not blocked by a dialog or another program"
            ) from None
        except Exception as error:  # noqa: BLE001
            # The client has no error class of its own: it raises a plain Exception for a refused
            # call, and any other error where an answer is not of the protocol.
            if type(error) is Exception:
                raise CoppeliaSimError(
                    f"CoppeliaSim at {self.address} refused {what}: {_in_words(str(error))}"
                ) from None
            self._abandon()
            raise CoppeliaSimUnreachable(
                f"the program at {self.address} does not answer {what} as CoppeliaSim 4.6 or newer "
                f"would ({type(error).__name__}); check the address"
            ) from None
        finally:
            self.last_call = time.monotonic()

    def _received(self, receive: Any) -> Any:
        left = self._deadline - time.monotonic()
        if left <= 0 or not self._client.socket.poll(int(left * 1000) + 1):
            raise _NoAnswer
        reply = receive()
        # The client would run any function of the main module that the server names.
        if isinstance(reply, dict) and reply.get("func", _SERVER_ASKS[0]) not in _SERVER_ASKS:
            raise _NotTheProtocol
        return reply

    def _abandon(self) -> None:
        client, self._client, self._sim = self._client, None, None
        if client is not None:
            client.socket.close(linger=0)
            client.context.term()


def _check_installed() -> None:
    if importlib.util.find_spec("coppeliasim_zmqremoteapi_client") is None:
        raise CoppeliaSimUnreachable(
            package_missing("CoppeliaSim", "coppeliasim", "coppeliasim-zmqremoteapi-client")
        )


def _check_listening(address: Address) -> None:
    """Report a refused connection at once; the client itself would go on trying."""
    try:
        socket.create_connection((address.host, address.port), timeout=CONNECT_WITHIN_S).close()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise CoppeliaSimUnreachable(
            f"nothing listens at {address} ({reason[0].lower()}{reason[1:]}); start CoppeliaSim "
            "there; its ZMQ remote API server listens on port 23000 by default"
        ) from None


def _new_client(address: Address) -> Any:
    from coppeliasim_zmqremoteapi_client import (  # type: ignore[import-untyped]
        RemoteAPIClient,
    )

    # It puts its own `require` into the main module, which would keep it alive for ever.
    main = sys.modules["__main__"].__dict__
    before = main.get("require", _MISSING)
    try:
        client = RemoteAPIClient(address.host, address.port, verbose=0)
    finally:
        if before is _MISSING:
            main.pop("require", None)
        else:
            main["require"] = before
    milliseconds = int(ANSWER_WITHIN_S * 1000)
    client.socket.linger = 0
    client.socket.rcvtimeo = milliseconds
    client.socket.sndtimeo = milliseconds
    client.timeout = FORGOTTEN_AFTER_S
    return client


def _in_words(message: str) -> str:
    line = message.split(_LUA_NEWLINE)[0].splitlines()[0] if message.strip() else "no reason given"
    return _WHERE.sub("", line).strip().rstrip(".")
