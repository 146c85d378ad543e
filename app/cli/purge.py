"""``dynamic-observer purge``: permanently delete what was deleted in the history."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

import typer

from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings


def purge(
    days: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=36500,
            help="Only what was deleted at least this many days ago; 0: everything. [default: 7]",
        ),
    ] = None,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Permanently remove deleted runs and ground truth.

    Their recordings are removed as well.
    """
    from app.storage import UNDO, Storage

    settings = chosen_settings(data=data, database=database)
    with Storage(settings.database_location, folder=settings.data) as storage:
        before = storage.folder.free_bytes()
        gone = storage.purge(UNDO if days is None else timedelta(days=days))
        freed = max(0, storage.folder.free_bytes() - before)
    typer.echo(f"{len(gone)} runs removed, {freed / 1e6:.0f} MB freed", err=True)
