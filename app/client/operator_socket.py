"""An operator's WebSocket to the server: leases, and the heartbeat that keeps robots moving."""

from __future__ import annotations

import contextlib
import json
import queue
import threading
import time
from urllib.parse import quote

from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from app.client.server_api import DrivingFailed, ServerApi, why
from app.contract.values import JsonObject
from observer.errors import InputError
from observer.rig.rig import Role

PRESENCE_INTERVAL_S = 0.1
_ANSWER_WITHIN_S = 3.0
# Name shown to other operators.
_CALLED = "the command line"
# A stalled link must not delay the end: the robots have stopped long before.
_CLOSE_WITHIN_S = 1.0


class OperatorSocket:
    """WebSocket that connects at once; its own thread sends a heartbeat ten times a second.

    The heartbeat covers every lease held, from the moment it is granted until it is released. When
    the connection, the process or this thread ends, the heartbeat ends too, and the robots stop.

    Raises:
        InputError: the server refuses this token. DrivingFailed: it does not answer.
    """

    def __init__(self, api: ServerApi) -> None:
        self._connection = _connected(api)
        self._lock = threading.Lock()
        self._sequence: dict[Role, int] = {}
        self._leases: queue.SimpleQueue[JsonObject] = queue.SimpleQueue()
        # Reason why driving cannot go on; the first one counts.
        self._over: str | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="operator", daemon=True)
        self._thread.start()

    def take(self, role: Role, *, takeover: bool) -> str:
        """Take the lease on a role and return the lease's id.

        Raises:
            DrivingFailed: somebody else drives it (and no takeover was requested), or the server
                does not answer.
        """
        self._send({"type": "take", "role": role, "takeover": takeover})
        deadline = time.monotonic() + _ANSWER_WITHIN_S
        while True:
            self.check()
            try:
                answer = self._leases.get(timeout=0.05)
            except queue.Empty:
                if time.monotonic() > deadline:
                    raise DrivingFailed(
                        f"the server did not grant control of the {role} within "
                        f"{_ANSWER_WITHIN_S:g} s"
                    ) from None
                continue
            if answer.get("role") != role:
                continue
            if answer.get("state") == "yours" and isinstance(answer.get("lease"), str):
                return str(answer["lease"])
            raise DrivingFailed(
                answer.get("sentence")
                or f"{answer.get('holder') or 'somebody else'} controls the {role}; use "
                "--takeover to take control"
            )

    def check(self) -> None:
        """Fail if a lease or the connection is lost.

        Raises:
            DrivingFailed: a lease or the connection is lost; the message gives the reason.
        """
        if self._over is not None:
            raise DrivingFailed(self._over)

    def release(self) -> tuple[Role, ...]:
        """Release all leases, so that the robots stop and are disarmed. Safe on a lost link.

        Returns:
            The roles held until now.
        """
        with self._lock:
            held, self._sequence = tuple(self._sequence), {}
        for role in held:
            with contextlib.suppress(DrivingFailed):
                self._send({"type": "release", "role": role})
        return held

    def close(self) -> None:
        """Stop the heartbeat; the leases end with the connection. Safe to call twice."""
        self._ending.set()
        self._connection.close()
        self._thread.join(_CLOSE_WITHIN_S + PRESENCE_INTERVAL_S)

    def __enter__(self) -> OperatorSocket:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        beat = time.monotonic()
        try:
            while not self._ending.is_set():
                now = time.monotonic()
                if now >= beat:
                    self._say_present()
                    # Missed heartbeats are not made up for.
                    beat = now + PRESENCE_INTERVAL_S
                try:
                    text = self._connection.recv(timeout=max(0.0, beat - time.monotonic()))
                except TimeoutError:
                    continue
                self._take_in(text)
        except DrivingFailed as error:
            self._end(str(error))
        except (WebSocketException, OSError) as error:
            said = str(error).rstrip(".")
            self._end(f"the connection to the server was lost ({said}); the robots stop")
        finally:
            self._end("the operator's socket was closed")

    def _end(self, reason: str) -> None:
        if self._over is None:
            self._over = reason

    def _say_present(self) -> None:
        with self._lock:
            numbers = {role: number + 1 for role, number in self._sequence.items()}
            self._sequence.update(numbers)
        now_ms = 1000 * time.monotonic()
        for role, number in numbers.items():
            self._send({"type": "present", "role": role, "sequence": number, "time": now_ms})

    def _take_in(self, text: str | bytes) -> None:
        try:
            message = json.loads(text)
            kind = message["type"]
        except (ValueError, KeyError, TypeError):
            raise DrivingFailed("the server sent an invalid message") from None
        if kind == "ping":
            now_ms = 1000 * time.monotonic()
            self._send({"type": "pong", "id": message.get("id"), "time": now_ms})
        elif kind == "lease":
            self._take_lease(message)

    def _take_lease(self, message: JsonObject) -> None:
        role: Role = message["role"]
        if message.get("state") == "yours":
            with self._lock:
                self._sequence.setdefault(role, 0)
            # Sent at once, so that it arrives before any request under this lease.
            self._say_present()
        elif message.get("state") == "lost":
            with self._lock:
                held = self._sequence.pop(role, None) is not None
            if held:
                who = message.get("holder") or "somebody else"
                self._end(message.get("sentence") or f"{who} took control of the {role}")
            return
        self._leases.put(message)

    def _send(self, message: JsonObject) -> None:
        try:
            self._connection.send(json.dumps(message))
        except (WebSocketException, OSError):
            raise DrivingFailed("the connection to the server was lost; the robots stop") from None


def _connected(api: ServerApi) -> ClientConnection:
    address = api.socket_address(f"/api/drive?name={quote(_CALLED)}")
    try:
        return connect(
            address,
            additional_headers=api.headers,
            # A proxy or compression would only delay the heartbeat.
            proxy=None,
            compression=None,
            open_timeout=_ANSWER_WITHIN_S,
            close_timeout=_CLOSE_WITHIN_S,
            # The server's own pings detect a dead link sooner.
            ping_interval=None,
        )
    except InvalidStatus as error:
        status = error.response.status_code
        if status in (401, 403):
            raise InputError(
                f"{api.address} rejects this token; copy it from the link that the server printed "
                "at start"
            ) from None
        raise DrivingFailed(f"{address} answered with status {status}") from None
    except (OSError, WebSocketException) as error:
        raise api.unanswered(why(error)) from None
