"""``dynamic-observer doctor``: check devices, permissions and data folder, and suggest remedies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from rich.console import Console

from app.cli.storage_options import DatabaseOption, DataOption
from app.settings import Settings

_EXIT_HINDERED = 1


def doctor(
    data: DataOption = None,
    database: DatabaseOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON object in place of words.")
    ] = False,
) -> None:
    """List cameras, ports, data folder and what to do about each problem; 1 if one hinders."""
    from app.doctor.examination import examine
    from app.doctor.telling import tell
    from observer.machine import Machine

    examination = examine(_settings(data, database), Machine())
    if as_json:
        typer.echo(json.dumps(examination.as_json(), indent=2, allow_nan=False))
    else:
        tell(examination, Console())
    raise typer.Exit(_EXIT_HINDERED if examination.hindered else 0)


def _settings(data: Path | None, database: str | None) -> Settings | str:
    given: dict[str, Any] = {"data": data, "database": database}
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        return "; ".join(
            ": ".join(filter(None, [".".join(map(str, each["loc"])), each["msg"]]))
            for each in error.errors()
        )
