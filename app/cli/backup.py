"""``dynamic-observer backup``: write all data to one file, even while a server runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar
from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings
from observer.number_format import count_of


def backup(
    file: Annotated[Path, typer.Argument(help="Output file, FILE.zip or FILE.tar.")],
    data: DataOption = None,
    database: DatabaseOption = None,
    recordings: Annotated[
        bool,
        typer.Option(
            "--recordings", help="Include recordings and saved clips, which may be large."
        ),
    ] = False,
) -> None:
    """Back up runs, settings and ground truth.

    Runs with their speeds, parameters, presets, calibrations, rig, programmes and ground truth.
    """
    from app.storage.backup import write_backup
    from observer.version import library_version

    settings = chosen_settings(data=data, database=database)
    with progress_bar("Backup") as progress:
        manifest = write_backup(
            file,
            settings.data,
            settings.database_location,
            recordings=recordings,
            application=library_version(),
            progress=progress,
        )
    size = sum(entry.size for entry in manifest.files.values())
    without = "" if recordings else ", without recordings (--recordings includes them)"
    files = count_of(len(manifest.files), "file")
    typer.echo(f"wrote {file}: {files}, {size / 1e6:.1f} MB{without}", err=True)
