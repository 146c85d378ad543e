"""``dynamic-observer evaluate``: how good the tracks of ``observe`` are, against truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from observer.evaluation.breakdown import LAB, ROAD, break_down, breakdown_tables
from observer.evaluation.evaluate import summarise
from observer.evaluation.lines import read_lines
from observer.evaluation.results import listed
from observer.evaluation.tally import tally
from observer.truth.csv_file import CsvTruth


def evaluate(
    tracks: Annotated[Path, typer.Argument(help="JSON lines written by observe.")],
    truth: Annotated[Path, typer.Option(help="truth.csv of the same frames.")],
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON on stdout.")] = False,
    road: Annotated[
        bool,
        typer.Option(
            "--road",
            help=f"Match within {ROAD.gate_m:g} m instead of {LAB.gate_m:g} m, and classes of "
            f"range and speed for roads.",
        ),
    ] = False,
) -> None:
    """Compare tracks with truth: recall, false obstacles, errors of position and velocity."""
    scale = ROAD if road else LAB
    counted = tally(read_lines(tracks), CsvTruth(truth), scale.gate_m)
    result, classes = summarise([counted]), break_down([counted], scale)
    if as_json:
        figures = {
            **result.as_dict(),
            "breakdown": classes.as_dict(),
            **listed(tuple(counted.false)),
        }
        typer.echo(json.dumps(figures, indent=2, allow_nan=False))
    else:
        typer.echo(f"{result.markdown()}\n{breakdown_tables({'': classes})}".rstrip())
