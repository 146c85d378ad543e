"""``dynamic-observer restore``: restore a backup and keep the previous data beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar
from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings


def restore(
    file: Annotated[Path, typer.Argument(help="What dynamic-observer backup wrote.")],
    data: DataOption = None,
    database: DatabaseOption = None,
    replace: Annotated[
        bool,
        typer.Option("--replace", help="Also where something is kept already; that stays beside."),
    ] = False,
) -> None:
    """Put a backup in place, checked as a whole before anything is touched."""
    from app.storage.restore import restore_backup

    settings = chosen_settings(data=data, database=database)
    with progress_bar("Restore") as progress:
        done = restore_backup(
            file, settings.data, settings.database_location, replace=replace, progress=progress
        )
    told = f"the backup of {done.manifest.made_at[:19].replace('T', ' ')} UTC is in {settings.data}"
    if done.kept:
        told += f"; what was there is kept as {', '.join(map(str, done.kept))}"
    typer.echo(told, err=True)
