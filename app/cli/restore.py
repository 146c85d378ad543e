"""``dynamic-observer restore``: restore a backup and keep the previous data beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar
from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings


def restore(
    file: Annotated[Path, typer.Argument(help="File written by dynamic-observer backup.")],
    data: DataOption = None,
    database: DatabaseOption = None,
    replace: Annotated[
        bool,
        typer.Option("--replace", help="Replace existing data; the old data is kept beside it."),
    ] = False,
) -> None:
    """Restore a backup.

    It is checked completely before anything is changed.
    """
    from app.storage.restore import restore_backup

    settings = chosen_settings(data=data, database=database)
    with progress_bar("Restore") as progress:
        done = restore_backup(
            file, settings.data, settings.database_location, replace=replace, progress=progress
        )
    message = (
        f"the backup of {done.manifest.made_at[:19].replace('T', ' ')} UTC is restored in "
        f"{settings.data}"
    )
    if done.kept:
        message += f"; the previous data is kept as {', '.join(map(str, done.kept))}"
    typer.echo(message, err=True)
