"""Sight of each frame from the engine, as the drive loop reads it."""

from __future__ import annotations

import logging

from app.runtime.latest import LatestReader
from observer.guard.sight import Sight, sight_of

_log = logging.getLogger(__name__)

# Both sides use the same clock: a later reception time than this is invalid.
_AHEAD_S = 0.05


class SightFeed:
    """Newest sight of a slot; never blocks."""

    def __init__(self, reader: LatestReader) -> None:
        self._reader = reader
        self._sequence = 0
        self._sight: Sight | None = None

    def newest(self, now: float) -> Sight | None:
        """Return the newest sight, however old; None where there is none, or none is readable."""
        value = self._reader.read(self._sequence)
        if value is not None:
            self._sequence = value.sequence
            try:
                self._sight = sight_of(value.header)
            except (KeyError, TypeError, ValueError) as error:
                if self._sight is not None:
                    _log.error("what the engine tells of a frame cannot be read: %r", error)
                self._sight = None
            if self._sight is not None and not self._sight.received <= now + _AHEAD_S:
                self._sight = None
        return self._sight
