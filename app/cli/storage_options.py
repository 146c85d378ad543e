"""Options for the data folder and the database of a command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from app.settings import Settings
from observer.errors import InputError

DataOption = Annotated[Path | None, typer.Option(help="Folder for runs and settings.")]
DatabaseOption = Annotated[
    str | None,
    typer.Option(
        help="Another database, as postgresql://user:password@host/name; a file in the data "
        "folder if left out."
    ),
]


def storage_settings(data: Path | None, database: str | None) -> Settings:
    """Return the settings: given values first, then the environment, then the defaults.

    Raises:
        InputError: a value is not understood.
    """
    given: dict[str, Any] = {"data": data, "database": database}
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise InputError("; ".join(each["msg"] for each in error.errors())) from None
