"""Endless tasks: a failure is logged, and the task starts again."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

_log = logging.getLogger(__name__)

_PAUSE_S = 1.0


async def keep_running(work: Callable[[], Awaitable[None]], what: str) -> None:
    """Run endless work until cancelled; if it fails, log why and start it again after a pause.

    Args:
        what: name of the work in the log.
    """
    while True:
        try:
            await work()
        except Exception:  # noqa: BLE001
            # Nobody waits for its end, so nobody else would report it.
            _log.exception("the %s failed and is started again in %g s", what, _PAUSE_S)
        await asyncio.sleep(_PAUSE_S)
