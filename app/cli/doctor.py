"""``dynamic-observer doctor``: check devices, permissions and data folder, and suggest remedies."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.console import Console

from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings
from app.settings import Settings
from observer.errors import InputError

_EXIT_HINDERED = 1


def doctor(
    data: DataOption = None,
    database: DatabaseOption = None,
    host: Annotated[str | None, typer.Option(help="Address to check, as for serve.")] = None,
    port: Annotated[
        int | None,
        typer.Option(help="Port to check: whether it is free, or which program uses it."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of text.")
    ] = False,
) -> None:
    """Check cameras, ports and the data folder.

    The exit code is 1 if a problem prevents the start.
    """
    from app.doctor.examination import examine
    from app.doctor.telling import tell
    from observer.machine import Machine

    settings: Settings | str
    try:
        settings = chosen_settings(data=data, database=database, host=host, port=port)
    except InputError as error:
        settings = str(error)
    examination = examine(settings, Machine())
    if as_json:
        typer.echo(json.dumps(examination.as_json(), indent=2, allow_nan=False))
    else:
        tell(examination, Console())
    raise typer.Exit(_EXIT_HINDERED if examination.hindered else 0)
