"""Options for the data folder and the database, and the settings made from options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from app.settings import Settings
from observer.errors import InputError
from observer.validation import validation_words, with_name

DataOption = Annotated[
    Path | None,
    typer.Option(help="Data folder: runs and settings. [default: ~/.local/share/dynamic-observer]"),
]
DatabaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="Database, such as postgresql://user:password@host/name. [default: a file in the "
        "data folder]",
    ),
]


def chosen_settings(**given: Any) -> Settings:
    """Return the settings: values other than None first, then the environment, then the defaults.

    Raises:
        InputError: a value is not understood; the sentence names its option.
    """
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise InputError("; ".join(map(_problem, error.errors()))) from None


def _problem(error: ErrorDetails) -> str:
    option = ".".join(map(str, error["loc"])).replace("_", "-")
    # A problem that concerns several options has no location.
    return with_name(f"--{option}" if option else "", validation_words(error))
