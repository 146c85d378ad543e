"""Filter for what libraries log about clients: one line per event, repetitions only counted.

Anyone who reaches the port can send nonsense as fast as they like, and tabs are closed in the
middle of anything; neither is worth a traceback or a full disk.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

# Connection errors that a client causes: disconnects and invalid text.
_ORDINARY = (ConnectionError, EOFError, TimeoutError, UnicodeError)
_WINDOW_S = 10.0
_MOST_KINDS = 200


@dataclass(eq=False)
class _Kind:
    since: float
    left_out: int = 0


class LibraryLog(logging.Filter):
    """Log handler filter that counts repeats within ten seconds; the next record states the count.

    Args:
        clock: monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock = clock
        self._kinds: dict[tuple[str, str], _Kind] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to log a record; shorten it if its cause is ordinary."""
        _shorten(record)
        key, now = (record.name, str(record.msg)), self._clock()
        kind = self._kinds.get(key)
        if kind is not None and now - kind.since < _WINDOW_S:
            kind.left_out += 1
            return False
        if kind is not None and kind.left_out:
            record.msg = f"{record.getMessage()} ({kind.left_out} more like it before)"
            record.args = ()
        if len(self._kinds) >= _MOST_KINDS:
            self._kinds.clear()
        self._kinds[key] = _Kind(now)
        return True


def _shorten(record: logging.LogRecord) -> None:
    """Replace the traceback of an ordinary error by the error itself."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, _ORDINARY):
        record.msg = f"{record.getMessage()} ({error})"
        record.args = ()
        record.exc_info = record.exc_text = None
