"""An operator as the server sees one: one drive socket, ten messages a second."""

from __future__ import annotations

import json
import threading
import time
from types import TracebackType
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from .bench import Refused, Server, wait_until

_PERIOD_S = 0.1
_ANSWER_S = 3.0


class Operator:
    """Signed in at ``/api/drive``; a context manager. Holds a velocity like a held key.

    Attributes:
        last_sign: monotonic time of the last command or presence message sent.
        messages: everything the server sent, oldest first.
    """

    def __init__(self, port: int, token: str, role: str = "observer") -> None:
        self.role = role
        self.lease: str | None = None
        self.last_sign = 0.0
        self.messages: list[dict[str, Any]] = []
        self.mute = False
        self._velocity: tuple[float, float] | None = None
        self._sequence = 0
        self._socket = connect(
            f"ws://127.0.0.1:{port}/api/drive",
            additional_headers={"Authorization": f"Bearer {token}"},
            compression=None,
            max_queue=None,
            proxy=None,
            close_timeout=0.2,
        )
        self._changed = threading.Condition()
        self._ends = threading.Event()
        self._threads = [
            threading.Thread(target=self._listen, name="operator listens"),
            threading.Thread(target=self._beat, name="operator's hand"),
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Operator:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.leave()

    def leave(self, *, abruptly: bool = False) -> None:
        """Close the socket; abruptly as if the network were gone."""
        self._ends.set()
        if abruptly:
            self._socket.socket.close()
        else:
            self._socket.close()
        for thread in self._threads:
            thread.join(5)

    def take(self, *, takeover: bool = False) -> dict[str, Any]:
        """Request the lease; return the answer."""
        before = len(self.messages)
        self._send({"type": "take", "role": self.role, "takeover": takeover})
        answer = self.wait_for("lease", after=before)
        self.lease = answer["lease"]
        return answer

    def hold(self, speed_mps: float, turn_rate_radps: float = 0.0) -> None:
        """Press the key for a velocity."""
        self._velocity = (speed_mps, turn_rate_radps)

    def release(self) -> None:
        """Release the key."""
        self._velocity = None
        self.drive(0.0, 0.0)

    def drive(self, speed_mps: float, turn_rate_radps: float, **changed: Any) -> None:
        """Send one command; ``changed`` replaces fields of the message."""
        self._sequence += 1
        self._send(
            {
                "type": "drive",
                "role": self.role,
                "sequence": self._sequence,
                "time": time.monotonic() * 1000,
                "speed_mps": speed_mps,
                "turn_rate_radps": turn_rate_radps,
                **changed,
            }
        )
        self.last_sign = time.monotonic()

    def wait_for(self, kind: str, *, after: int = 0) -> dict[str, Any]:
        """Return the first message of a kind after the first ``after`` ones."""
        deadline = time.monotonic() + _ANSWER_S
        with self._changed:
            while True:
                for message in self.messages[after:]:
                    if message["type"] == kind:
                        return message
                left = deadline - time.monotonic()
                if left <= 0 or not self._changed.wait(left):
                    said = self.messages[after:]
                    raise AssertionError(f"no {kind} within {_ANSWER_S} s, only {said}")

    def _send(self, message: dict[str, Any]) -> None:
        self._socket.send(json.dumps(message))

    def _listen(self) -> None:
        try:
            for text in self._socket:
                message = json.loads(text)
                if message["type"] == "ping" and not self.mute:
                    answer = {"type": "pong", "id": message["id"]}
                    self._send({**answer, "time": time.monotonic() * 1000})
                if message["type"] == "lease" and message["state"] == "lost":
                    self.lease = None
                with self._changed:
                    self.messages.append(message)
                    self._changed.notify_all()
        except (ConnectionClosed, OSError):
            return

    def _beat(self) -> None:
        due = time.monotonic()
        while not self._ends.wait(max(0.0, due - time.monotonic())):
            due += _PERIOD_S
            if self.lease is None or self.mute:
                continue
            try:
                if self._velocity is None:
                    self._present()
                else:
                    self.drive(*self._velocity)
            except (ConnectionClosed, OSError):
                return

    def _present(self) -> None:
        self._sequence += 1
        self._send(
            {
                "type": "present",
                "role": self.role,
                "sequence": self._sequence,
                "time": time.monotonic() * 1000,
            }
        )
        self.last_sign = time.monotonic()


def arm(server: Server, operator: Operator) -> None:
    """Arm the observer with the operator's lease, resetting a stop first."""

    def armed() -> bool:
        if server.robot()["state"] in ("armed", "moving"):
            return True
        try:
            server.request("POST", "/robots/observer/arm", {"lease": operator.lease})
        except Refused as error:
            if "reset" in str(error) or "stopped" in str(error) or "fault" in str(error):
                server.request("POST", "/robots/reset")
            return False
        return True

    wait_until("the robot is armed", armed, 10.0)
