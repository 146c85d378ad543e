"""Values that the engine computes for each frame, as the drive loop reads them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, Generic, Protocol, TypeVar

from app.runtime.latest import LatestReader

_log = logging.getLogger(__name__)

# Both sides use the same clock: a later reception time than this is invalid.
_AHEAD_S = 0.05


class _Received(Protocol):
    @property
    def received(self) -> float:
        """The host's monotonic clock at the frame's reception."""
        ...


Value = TypeVar("Value", bound=_Received)


class EngineFeed(Generic[Value]):
    """Newest value of a slot; never blocks."""

    def __init__(self, reader: LatestReader, of: Callable[[Mapping[str, Any]], Value]) -> None:
        """``of`` makes a value from its facts, or raises ``KeyError, TypeError, ValueError``."""
        self._reader = reader
        self._of = of
        self._sequence = 0
        self._value: Value | None = None

    def newest(self, now: float) -> Value | None:
        """Return the newest value, however old; None if there is none or it is unreadable."""
        read = self._reader.read(self._sequence)
        if read is not None:
            self._sequence = read.sequence
            try:
                self._value = self._of(read.header)
            except (KeyError, TypeError, ValueError) as error:
                if self._value is not None:
                    _log.error("the engine's data for a frame cannot be read: %r", error)
                self._value = None
            if self._value is not None and not self._value.received <= now + _AHEAD_S:
                self._value = None
        return self._value
