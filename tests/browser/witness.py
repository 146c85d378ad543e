"""How soon a robot is sent zero: polls the server independently of the page."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

# Number of attempts at holding a control, in case a busy machine holds up the page.
TRIES = 5
_WITHIN_S = 0.3
# Allowance for the polling itself on a busy machine.
_ASKING_S = 0.1
_ASK_EVERY_S = 0.015


class Witness:
    """Polls the server for the velocity sent to a robot."""

    def __init__(self, server: Any, role: str = "obstacle") -> None:
        self._api = server.api
        self._role = role
        self._ended = threading.Event()
        self._said: list[tuple[float, bool]] = []
        self._thread = threading.Thread(target=self._ask)

    def _ask(self) -> None:
        while not self._ended.wait(_ASK_EVERY_S):
            robot = self._api.get("/api/robots").json()["robots"][self._role]
            moves = robot is not None and any(robot["sent"].values())
            self._said.append((time.monotonic(), moves))

    def __enter__(self) -> Witness:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def first(self, moves: bool, start: float, within_s: float) -> float | None:
        """Return when it was first reported as moving, or not, from ``start`` on."""
        while time.monotonic() < start + within_s:
            for at, said in tuple(self._said[-100:]):
                if at >= start and said == moves:
                    return at
            time.sleep(0.005)
        return None

    @property
    def moves(self) -> bool:
        return bool(self._said) and self._said[-1][1]

    def zero_after(self, start: float) -> float:
        """Return how long after ``start`` it was sent zero."""
        at = self.first(False, start, 3.0)
        assert at is not None, "it was not stopped"
        return at - start

    def stays_zero(self, for_s: float) -> None:
        start = time.monotonic()
        time.sleep(for_s)
        assert not any(moves for at, moves in self._said if at >= start)


def report(what: str, *seconds: float) -> None:
    """Print the worst delay and assert that it is short enough."""
    sys.stdout.write(f"\n{what}: zero after {1000 * max(seconds):.0f} ms at worst\n")
    assert max(seconds) <= _WITHIN_S + _ASKING_S, what
