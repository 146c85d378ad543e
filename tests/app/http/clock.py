"""A clock that stands still until a test sets it."""

from __future__ import annotations


class Clock:
    """Callable in place of a clock; ``now`` is what it shows."""

    def __init__(self, now: float = 5000.0) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now
