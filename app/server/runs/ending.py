"""Ending a run: in the engine, and in the database as soon as the disk has room for it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

import structlog

from app.contract.commands import StopRun
from app.contract.status import RecordingStatus
from app.server.asking import ask
from app.server.contracts import Engine
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.source.opening import Opening
from app.server.writer import Writer
from app.storage import RunRecord, StorageError, StorageFull

log = structlog.get_logger(__name__)

_PATIENCE_S = 2.0
_AGAIN_S = 2.0


async def end_recording(engine: Engine, opening: Opening) -> RecordingStatus | None:
    """Have the engine end the run; what became of its recording, None where it cannot tell."""
    recording = None
    with contextlib.suppress(NotAvailable, Conflict, FieldError, StorageFull):
        recording = await ask(engine, StopRun())
        if not opening.endless:
            # Its run ended with the recording; the preview goes round.
            await ask(engine, opening.preview_playback)
    return recording


async def write_end(
    writer: Writer,
    write: Callable[[], RunRecord],
    run_id: str,
    soon: Callable[[Awaitable[None]], None],
    *,
    again_s: float = _AGAIN_S,
) -> RunRecord | None:
    """The record as it was written; None where it could not be written in time.

    A run is over whether or not that could be written: stopping always works. A locked database is
    tried further by the writer, a full disk in the background.

    Args:
        write: writes the end. soon: has work done that nobody waits for.
    """
    try:
        return await writer.submit(write, timeout_s=_PATIENCE_S)
    except StorageFull as error:
        log.error("end_of_run_not_written", run=run_id, reason=str(error))
        soon(_write_with_room(writer, write, again_s))
    except (NotAvailable, StorageError) as error:
        log.error("end_of_run_not_written", run=run_id, reason=str(error))
    return None


async def _write_with_room(writer: Writer, write: Callable[[], RunRecord], again_s: float) -> None:
    while True:
        await asyncio.sleep(again_s)
        try:
            await writer.submit(write)
        except (StorageFull, NotAvailable):
            continue
        return
