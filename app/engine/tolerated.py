"""Work beside observing that may fail: pictures and checks that nothing depends on."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from app.engine.errors import unexpected

_log = logging.getLogger(__name__)


class Tolerated:
    """Pieces of work whose failures are reported and end nothing; for one thread.

    Robots drive by the loop that observes and a run is recorded by it: a picture that cannot be
    drawn must stop neither, nor the next attempt.
    """

    def __init__(self) -> None:
        self._troubles: dict[str, str] = {}
        # Logged once: the next frame is likely to fail in the same way, many times a second.
        self._logged: set[tuple[str, type[Exception]]] = set()

    @property
    def troubles(self) -> tuple[str, ...]:
        """Return one sentence on each piece of work that failed when it was last tried."""
        return tuple(self._troubles.values())

    @contextmanager
    def work(self, what: str) -> Iterator[None]:
        """Try a piece of work.

        Args:
            what: names it, in words that "failed" may follow.
        """
        try:
            yield
        except Exception as error:  # noqa: BLE001
            if (what, type(error)) not in self._logged:
                self._logged.add((what, type(error)))
                _log.exception("%s failed", what)
            # The first sentence stays: one that differed with each frame would be news each time.
            self._troubles.setdefault(what, f"{what} failed: {unexpected(error)}")
        else:
            self._troubles.pop(what, None)

    def forget(self) -> None:
        """Forget the troubles, because what failed is not wanted any more."""
        self._troubles.clear()
