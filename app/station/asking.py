"""Requests to the engine whose refusals become the station's own errors."""

from __future__ import annotations

from typing import Any

from app.messages import Command
from app.station.contracts import Engine
from app.station.errors import Conflict, FieldError, NotAvailable
from app.supervisor import EngineRefused, EngineUnavailable


async def ask(
    engine: Engine, command: Command, *, field: tuple[str, ...] = ("body",), timeout_s: float = 10.0
) -> dict[str, Any]:
    """Send a command and return its reply's value.

    Args:
        field: the part of the person's request that the command stems from.

    Raises:
        FieldError: what was asked is wrong. Conflict: it is not possible in this state.
        NotAvailable: it failed, or there is no engine at the moment.
    """
    try:
        return await engine.request(command, timeout_s)
    except EngineRefused as error:
        if error.refusal == "input":
            raise FieldError(field, str(error)) from error
        if error.refusal == "state":
            raise Conflict(str(error)) from error
        raise NotAvailable(str(error)) from error
    except EngineUnavailable as error:
        raise NotAvailable(str(error)) from error
