"""``dynamic-observer truth``: describe how a ground-truth file is read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from app.cli.truth_options import AnglesOption, RateOption
from observer.truth.files.known import AngleReading, names_in_words


def truth(
    file: Annotated[
        Path,
        typer.Argument(help=f"Motion capture ({names_in_words()}), or a truth.csv."),
    ],
    rate: RateOption = None,
    angles: AnglesOption = None,
    output: Annotated[
        Path | None, typer.Option(help="Write the description to this file, as JSON.")
    ] = None,
) -> None:
    """Describe a motion-capture file.

    Its bodies, frame rate, units, angles and gaps.
    """
    from app.reports.result_files import write_file
    from observer.truth.files.angles import AnglesUnclear

    try:
        answer = _understood(file, rate, angles)
    except AnglesUnclear as error:
        if output is None:
            raise
        # An open question, for the caller to pass on to the user.
        answer = {"question": str(error)}
    if output is not None:
        write_file(output, json.dumps(answer, allow_nan=False).encode())
        return
    rate_hz = "" if answer["rate_hz"] is None else f", {answer['rate_hz']:g} Hz"
    duration = "" if answer["duration_s"] is None else f", {answer['duration_s']:.1f} s"
    typer.echo(f"{answer['format']}{rate_hz}{duration}")
    for body in answer["bodies"]:
        speed = body["highest_speed_mps"]
        fastest = "" if speed is None else f", up to {speed:.2f} m/s"
        typer.echo(f"  {body['name']}: {body['seen']} samples, {body['gaps']} missing{fastest}")
    for note in answer["notes"]:
        typer.echo(f"  {note}")


def _understood(file: Path, rate: float | None, angles: AngleReading | None) -> dict[str, Any]:
    from app.reports.comparison import ALIGNED_ALREADY
    from observer.truth.csv_file import CsvTruth
    from observer.truth.files.description import describe_capture
    from observer.truth.files.recognition import file_kind, read_capture

    if file_kind(file) != ALIGNED_ALREADY:
        return describe_capture(read_capture(file, rate_hz=rate, angles=angles))
    CsvTruth(file)
    return {
        "format": ALIGNED_ALREADY,
        "rate_hz": None,
        "duration_s": None,
        "bodies": [],
        "notes": ["it is on the run's own clock and in its world frame, so it needs no alignment"],
    }
