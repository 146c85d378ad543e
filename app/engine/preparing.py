"""Prepares the compiled vision code in a separate thread, while the engine stays responsive."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from app.runtime.heap import keep_for_good

_log = logging.getLogger(__name__)

# Prepares what every observer needs; passes one sentence to its argument if that takes a while.
Preparation = Callable[[Callable[[str], None]], None]


class Preparing:
    """Work that must be done before a source can be observed.

    Attributes:
        note: why it takes a while, in one sentence; None if it does not, or is done.
    """

    def __init__(self, prepare: Preparation = lambda _: None) -> None:
        self._prepare = prepare
        self._done = threading.Event()
        self.note: str | None = None

    def start(self) -> None:
        """Start the work in a thread; use ``wait`` to wait for it."""
        threading.Thread(target=self._run, name="compiling the vision code", daemon=True).start()

    def wait(self) -> None:
        """Wait until it is done."""
        self._done.wait()

    def _tell(self, note: str) -> None:
        self.note = note
        _log.warning("%s", note)

    def _run(self) -> None:
        try:
            self._prepare(self._tell)
        except Exception:  # noqa: BLE001
            # The caller that needs it retries and reports the error.
            _log.exception("compiling the vision code failed")
        finally:
            # The compiler's modules hold most of the process's objects.
            keep_for_good()
            self.note = None
            self._done.set()
