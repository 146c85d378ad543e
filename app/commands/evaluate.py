"""``dynamic-observer evaluate``: how good the tracks of ``observe`` are, against truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def evaluate(
    tracks: Annotated[Path, typer.Argument(help="JSON lines written by observe.")],
    truth: Annotated[Path, typer.Option(help="truth.csv of the same frames.")],
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON on stdout.")] = False,
    road: Annotated[
        bool, typer.Option("--road", help="Match within 3 m instead of 0.5 m, for road scenes.")
    ] = False,
) -> None:
    """Compare tracks with truth: recall, false obstacles, errors of position and velocity."""
