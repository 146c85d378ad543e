"""End of a run: in the engine, and in the database as soon as the disk has room."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

import structlog

from app.contract.commands import SetPlayback, StopRun
from app.contract.status import RecordingStatus
from app.server.asking import ask
from app.server.contracts import Engine
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.source.chosen_source import ChosenSource
from app.server.writer import Writer
from app.storage import RunRecord, StorageError, StorageFull

log = structlog.get_logger(__name__)

_PATIENCE_S = 2.0
_AGAIN_S = 2.0


async def end_recording(engine: Engine, chosen: ChosenSource) -> RecordingStatus | None:
    """End the run in the engine; return the status of its recording, None if unknown."""
    recording = None
    with contextlib.suppress(NotAvailable, Conflict, FieldError, StorageFull):
        recording = await ask(engine, StopRun())
        if not chosen.endless:
            # During the run the source played only once; the preview loops it again.
            await ask(engine, SetPlayback(loop=True))
    return recording


async def write_end(
    writer: Writer,
    write: Callable[[], RunRecord],
    run_id: str,
    soon: Callable[[Awaitable[None]], None],
    *,
    again_s: float = _AGAIN_S,
) -> RunRecord | None:
    """Write the end of a run and return the record; None if it could not be written in time.

    The run is over even if the write fails: stopping always works. The writer keeps trying a locked
    database; a background task keeps trying a full disk.

    Args:
        write: writes the end. soon: starts work in the background.
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
