"""Options and signals of commands that drive robots through a running server."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

DEFAULT_SERVER = "http://127.0.0.1:8080"
# Shells report a process ended by a signal this way.
_SIGNALLED = 128

ServerAddress = Annotated[str, typer.Option(help="Address of the running server.")]
Token = Annotated[
    str | None,
    typer.Option(
        help="Token of the server; other users of this computer can see it in the process list."
    ),
]
TokenFile = Annotated[
    Path | None, typer.Option(help="File with the token, as given to serve --token-file.")
]
Takeover = Annotated[
    bool, typer.Option("--takeover", help="Take control even if somebody else has it.")
]


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End the drive in order on Ctrl-C, a closed terminal or SIGTERM."""

    def end(number: int, _: object) -> None:
        raise typer.Exit(_SIGNALLED + number)

    ending = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {each: signal.signal(each, end) for each in ending}
    try:
        yield
    except typer.Exit:
        typer.echo("interrupted; the robots are stopped and disarmed", err=True)
        raise
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
