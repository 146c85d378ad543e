"""``dynamic-observer chart``: figure 17 of one run, as an image or as data."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from app.cli.finite import finite
from app.cli.results import FIGURE_SUFFIXES
from app.cli.run_choice import ComparedOption, RunArgument, chosen_run
from app.cli.storage_options import DatabaseOption, DataOption
from observer.errors import InputError

_ENDINGS = (".csv", ".json", *FIGURE_SUFFIXES)


def chart(
    run: RunArgument,
    output: Annotated[
        Path,
        typer.Option(help=f"Output file; the extension decides the format: {', '.join(_ENDINGS)}."),
    ],
    begin: Annotated[
        float | None,
        typer.Option(
            callback=finite, help="Seconds on the source's clock. [default: the start of the run]"
        ),
    ] = None,
    end: Annotated[
        float | None,
        typer.Option(
            callback=finite, help="Seconds on the source's clock. [default: the end of the run]"
        ),
    ] = None,
    title: Annotated[
        str | None, typer.Option(help="Title of the figure. [default: the name of the run]")
    ] = None,
    compared: ComparedOption = None,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Plot a run's speeds over time.

    Estimated, true, commanded and wheel-encoder speeds.
    """
    from app.contract.values import plain
    from app.reports.comparison import gather_compared
    from app.reports.result_files import write_file
    from app.reports.run_chart import chart_csv, chart_values
    from app.reports.stretches import during
    from observer.recording.reader import Recording

    ending = output.suffix.lower()
    if ending not in _ENDINGS:
        raise InputError(f"unknown extension in {output.name}; use {', '.join(_ENDINGS)}")
    if begin is not None and end is not None and begin >= end:
        raise InputError(f"the end must be after the start, not at {end:g} s")
    path, comparison = chosen_run(run, compared, data, database)
    gathered = gather_compared(path, comparison)
    if begin is not None or end is not None:
        gathered = during(
            gathered, -math.inf if begin is None else begin, math.inf if end is None else end
        )
    if ending in FIGURE_SUFFIXES:
        if title is None:
            with Recording(path) as recording:
                title = recording.facts.name or recording.facts.id
        # The plotting code takes as long to import as everything else.
        from app.reports.speed_figure import speed_figure
        from observer.figures import figure_bytes

        figure = speed_figure([(title, gathered)])
        if begin is not None or end is not None:
            # The requested range is shown even if no value is known at its ends.
            figure.axes[0].set_xlim(begin, end)
        content = figure_bytes(figure, "speed", ending[1:])
    elif ending == ".csv":
        content = chart_csv(chart_values(gathered)).encode()
    else:
        content = json.dumps(plain(chart_values(gathered)), allow_nan=False).encode()
    write_file(output, content)
    typer.echo(f"wrote {output}", err=True)
