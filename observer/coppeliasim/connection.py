"""One conversation with a simulator, through its own client, that never lasts for ever.

The client itself waits without limit for an answer. Here every call has a deadline; one that
passes it leaves the client unusable (a request without its reply), so the conversation is closed
and a new one must be begun.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
import socket
import sys
import threading
import time
from typing import Any

from observer.coppeliasim.address import Address
from observer.errors import SourceError

# For the whole of a call. Shorter than an engine may be silent before it is taken for hung.
ANSWER_WITHIN_S = 1.0
CONNECT_WITHIN_S = 1.0
# The simulator forgets a client that was silent for so long. One that stepped it and died holds
# it still for that time, so it is short, and whoever steps shows itself in between.
FORGOTTEN_AFTER_S = 1.0
# What protocol 2 may ask of a client that offers no functions to be called back.
_SERVER_ASKS = ("_*wait*_", "_*repeat*_")
_WHERE = re.compile(r'^\[string "[^"]*"\]:\d+:\s*')
_LUA_NEWLINE = "_=NL=_"
_MISSING = object()


class CoppeliaSimError(SourceError):
    """The simulator refused a call, or its scene is not as needed."""


class CoppeliaSimUnreachable(CoppeliaSimError):
    """The simulator does not answer, or not by the protocol; the conversation is over."""


class _NoAnswer(Exception):
    """The deadline passed."""


class _NotTheProtocol(Exception):
    """An answer that protocol 2 does not have."""


class Connection:
    """A conversation. Calls may come from several threads; one is made at a time.

    Raises:
        CoppeliaSimUnreachable: the extra is not installed, nobody listens there, or what listens
            does not answer as CoppeliaSim does.
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
        """What ``sim.FUNCTION(*arguments)`` returns: nothing, a value or a tuple.

        Raises:
            CoppeliaSimError: the simulator refused it.
            CoppeliaSimUnreachable: it did not answer in time; the conversation is closed.
        """
        with self._lock:
            if self._client is None:
                raise CoppeliaSimUnreachable(
                    f"the connection to CoppeliaSim at {self.address} is closed; open it again"
                )
            called = getattr(self._sim, function, None)
            if not callable(called):
                raise CoppeliaSimError(
                    f"CoppeliaSim at {self.address} has no function sim.{function}; "
                    f"version 4.6 or newer is needed"
                )
            return self._answered(f"sim.{function}", within_s, called, *arguments)

    def constant(self, *names: str) -> int:
        """The first of these constants of ``sim`` that this version has.

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
        """Whether this version has a function of this name."""
        return callable(getattr(self._sim, function, None))

    def close(self) -> None:
        """Take leave, if it still listens, and release the socket; safe to call twice."""
        with self._lock:
            client = self._client
            if client is None:
                return
            # An unfinished call, and a client that was never understood, have no farewell.
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
                f"CoppeliaSim at {self.address} did not answer {what} within {within_s:g} s; see "
                f"that it runs and that no dialog or other program holds it"
            ) from None
        except Exception as error:  # noqa: BLE001
            # The client has no error of its own: it raises a plain one for what was refused, and
            # stumbles over what is not the protocol.
            if type(error) is Exception:
                raise CoppeliaSimError(
                    f"CoppeliaSim at {self.address} refused {what}: {_in_words(str(error))}"
                ) from None
            self._abandon()
            raise CoppeliaSimUnreachable(
                f"what listens at {self.address} does not answer {what} as CoppeliaSim 4.6 or "
                f"newer does ({type(error).__name__}); see that the address is right"
            ) from None
        finally:
            self.last_call = time.monotonic()

    def _received(self, receive: Any) -> Any:
        left = self._deadline - time.monotonic()
        if left <= 0 or not self._client.socket.poll(int(left * 1000) + 1):
            raise _NoAnswer
        reply = receive()
        # The client would run any function of the main program that the server names.
        if isinstance(reply, dict) and reply.get("func", _SERVER_ASKS[0]) not in _SERVER_ASKS:
            raise _NotTheProtocol
        return reply

    def _abandon(self) -> None:
        client, self._client, self._sim = self._client, None, None
        if client is None:
            return
        client.socket.close(linger=0)
        client.context.term()


def _check_installed() -> None:
    if importlib.util.find_spec("coppeliasim_zmqremoteapi_client") is None:
        raise CoppeliaSimUnreachable(
            "CoppeliaSim needs its client; install it by: "
            "pip install 'dynamic-observer[coppeliasim]'"
        )


def _check_listening(address: Address) -> None:
    """A refused connection is told at once, while the client would go on trying."""
    try:
        with socket.create_connection((address.host, address.port), timeout=CONNECT_WITHIN_S):
            pass
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise CoppeliaSimUnreachable(
            f"nothing listens at {address} ({reason[0].lower()}{reason[1:]}); start CoppeliaSim "
            f"there, whose ZMQ remote API server listens at port 23000 unless told otherwise"
        ) from None


def _new_client(address: Address) -> Any:
    from coppeliasim_zmqremoteapi_client import (  # type: ignore[import-untyped]
        RemoteAPIClient,
    )

    # It puts its own `require` into the main program, and so would live for ever.
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
