"""``dynamic-observer evaluate``: how good the tracks of ``observe`` are, against truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from observer.evaluation.evaluate import evaluate as compare
from observer.evaluation.lines import read_lines
from observer.evaluation.tally import GATE_M, ROAD_GATE_M
from observer.truth.csv_file import CsvTruth


def evaluate(
    tracks: Annotated[Path, typer.Argument(help="JSON lines written by observe.")],
    truth: Annotated[Path, typer.Option(help="truth.csv of the same frames.")],
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON on stdout.")] = False,
    road: Annotated[
        bool,
        typer.Option(
            "--road", help=f"Match within {ROAD_GATE_M:g} m instead of {GATE_M:g} m, for roads."
        ),
    ] = False,
) -> None:
    """Compare tracks with truth: recall, false obstacles, errors of position and velocity."""
    result = compare(read_lines(tracks), CsvTruth(truth), gate_m=ROAD_GATE_M if road else GATE_M)
    typer.echo(json.dumps(result.as_dict(), indent=2) if as_json else result.markdown().rstrip())
