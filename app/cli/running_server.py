"""Options and signals of commands that drive robots through a running server."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from observer.errors import DynamicObserverError

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
    """End the drive in an orderly way on Ctrl-C, a closed terminal or SIGTERM."""

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


@contextmanager
def summarized(
    summary: Callable[[], dict[str, Any]], done: str, *, as_json: bool
) -> Iterator[None]:
    """Print one JSON object about the drive in the block, however it ends, if ``as_json``.

    Args:
        summary: of the drive. done: name of the fact that it was completed; ``reason`` says why it
            was not.
    """
    reason: str | None = "interrupted"
    try:
        yield
        reason = None
    except DynamicObserverError as error:
        reason = str(error)
        raise
    finally:
        if as_json:
            ended = {done: reason is None, "reason": reason}
            typer.echo(json.dumps({**summary(), **ended}, allow_nan=False))
