"""Wheel odometry and errand of the observer, as sent to the engine by the drive process."""

from __future__ import annotations

from typing import Any

from app.runtime.latest import LatestReader
from observer.navigation.errand import Errand, errand_of
from observer.rig.rig import OBSERVER
from observer.rig.wheel_history import odometry_at
from observer.types import Odometry

# A robot whose newest report is older than this is gone.
_GONE_S = 1.0


class WheelFeed:
    """Reader of the slot ``WHEELS_NAME``; never blocks."""

    def __init__(self, reader: LatestReader) -> None:
        self._reader = reader
        self._sequence = 0
        self._history: list[list[float]] = []
        self._errand: Errand | None = None

    def there(self, now: float) -> bool:
        """Return whether a robot carries the cameras.

        Args:
            now: the host's monotonic clock.
        """
        self._read()
        return bool(self._history) and now - self._history[-1][0] <= _GONE_S

    def odometry(self, received: float) -> Odometry | None:
        """Return the observer's odometry at the time a frame was received; None without any."""
        self._read()
        return odometry_at(self._history, received)

    def errand(self, now: float) -> Errand | None:
        """Return the observer's errand; None while it has none, or its robot is gone.

        Args:
            now: the host's monotonic clock.
        """
        self._read()
        errand = self._errand
        return None if errand is None or now - errand.time > _GONE_S else errand

    def _read(self) -> None:
        value = self._reader.read(self._sequence)
        if value is not None:
            self._sequence = value.sequence
            self._history = _rows(value.header)
            self._errand = _errand(value.header)


def _rows(header: dict[str, Any]) -> list[list[float]]:
    rows = header.get(OBSERVER, [])
    try:
        return [[float(value) for value in row] for row in rows if len(row) == 4]
    except (TypeError, ValueError):
        return []


def _errand(header: dict[str, Any]) -> Errand | None:
    facts = header.get("errand")
    try:
        return None if facts is None else errand_of(facts)
    except ValueError:
        return None
