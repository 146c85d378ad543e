"""Rows that wait until the database takes them."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from app.storage import SpeedRow


class PendingRows:
    """Rows in the order in which they came; the oldest make place where there are too many.

    Args:
        most: that wait at a time.

    Attributes:
        lost: how many had to make place.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        # The writer's thread takes what the event loop adds.
        self._lock = threading.Lock()
        self._rows: list[SpeedRow] = []
        self.lost = 0

    def add(self, rows: Iterable[SpeedRow]) -> None:
        """Behind those that are here."""
        with self._lock:
            self._rows.extend(rows)
            self._make_place()

    def take(self) -> list[SpeedRow]:
        """All of them, which then are the taker's."""
        with self._lock:
            rows, self._rows = self._rows, []
            return rows

    def give_back(self, rows: list[SpeedRow]) -> None:
        """What was taken and could not be written, before those that came since."""
        with self._lock:
            self._rows[:0] = rows
            self._make_place()

    def _make_place(self) -> None:
        more = len(self._rows) - self._most
        if more > 0:
            del self._rows[:more]
            self.lost += more
