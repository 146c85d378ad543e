"""Waiting until something holds, with a deadline that only a fault can reach."""

from __future__ import annotations

import asyncio
import inspect
import time
from collections.abc import Callable
from typing import Any

WITHIN_S = 30.0


def until(
    ask: Callable[[], Any],
    what: str = "",
    within_s: float = WITHIN_S,
    *,
    accept: Callable[[Any], object] = bool,
    pause_s: float = 0.005,
) -> Any:
    """Ask until the answer is true, or accepted; return it.

    Args:
        what: what is awaited; if empty, a failure quotes the code of ``ask``.

    Raises:
        AssertionError: it did not come in time.
    """
    deadline = time.monotonic() + within_s
    while not accept(answer := ask()):
        assert time.monotonic() < deadline, _failure(ask, what, within_s, answer)
        time.sleep(pause_s)
    return answer


async def until_async(
    ask: Callable[[], Any], what: str = "", within_s: float = WITHIN_S, *, pause_s: float = 0.005
) -> Any:
    """Do the same as ``until`` in an event loop."""
    deadline = time.monotonic() + within_s
    while not (answer := ask()):
        assert time.monotonic() < deadline, _failure(ask, what, within_s, answer)
        await asyncio.sleep(pause_s)
    return answer


def _failure(ask: Callable[[], Any], what: str, within_s: float, answer: object) -> str:
    return f"not within {within_s:g} s: {what or _code(ask)}; the last answer was {answer!r}"


def _code(ask: Callable[[], Any]) -> str:
    try:
        return " ".join(inspect.getsource(ask).split())
    except (OSError, TypeError):
        return repr(ask)
