"""Requests to the other processes; their refusals become the server's own errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from app.contract.commands import Answer, ToEngine
from app.contract.drive import ToDrive
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.server.contracts import Drive, Engine
from app.server.errors import Conflict, FieldError, NotAvailable
from app.storage import StorageFull


async def ask(
    engine: Engine,
    command: ToEngine[Answer],
    *,
    field: tuple[str, ...] = ("body",),
    timeout_s: float = 10.0,
    repeatable: bool = False,
) -> Answer:
    """Send the engine a command and return the value of its reply.

    Args:
        field: the part of the user's request that caused the command.
        repeatable: as for ``Engine.request``.

    Raises:
        FieldError: the request is invalid. Conflict: it is not possible in this state.
        StorageFull: the disk is full.
        NotAvailable: it failed, or there is no engine at the moment.
    """
    with _own_errors(field):
        return await engine.request(command, timeout_s, repeatable=repeatable)


async def ask_drive(drive: Drive, command: ToDrive[Answer], *, timeout_s: float = 1.0) -> Answer:
    """Send the drive process a command; otherwise the same as ``ask``."""
    with _own_errors(("body",)):
        return await drive.request(command, timeout_s)


@contextmanager
def _own_errors(field: tuple[str, ...]) -> Iterator[None]:
    try:
        yield
    except ProcessRefused as error:
        if error.refusal == "input":
            raise FieldError(field, str(error)) from error
        if error.refusal == "state":
            raise Conflict(str(error)) from error
        if error.refusal == "full":
            raise StorageFull(str(error)) from error
        raise NotAvailable(str(error)) from error
    except ProcessUnavailable as error:
        raise NotAvailable(str(error)) from error
