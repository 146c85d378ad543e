"""Queue of rows that wait for the database."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from app.storage import SpeedRow


class PendingRows:
    """Queue of rows in order of arrival; the oldest are dropped if there are too many.

    Args:
        most: maximum number of waiting rows.

    Attributes:
        lost: number of dropped rows.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        # The writer's thread takes what the event loop adds.
        self._lock = threading.Lock()
        self._rows: list[SpeedRow] = []
        self.lost = 0

    def add(self, rows: Iterable[SpeedRow]) -> None:
        """Append rows."""
        with self._lock:
            self._rows.extend(rows)
            self._make_place()

    def take(self) -> list[SpeedRow]:
        """Remove and return all rows."""
        with self._lock:
            rows, self._rows = self._rows, []
            return rows

    def give_back(self, rows: list[SpeedRow]) -> None:
        """Put unwritten rows back in front of those that arrived since."""
        with self._lock:
            self._rows[:0] = rows
            self._make_place()

    def _make_place(self) -> None:
        more = len(self._rows) - self._most
        if more > 0:
            del self._rows[:more]
            self.lost += more
