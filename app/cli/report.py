"""``dynamic-observer report``: reproduce the paper's figures from a run, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar
from app.cli.run_choice import ComparedOption, RunArgument, chosen_run
from app.cli.storage_options import DatabaseOption, DataOption


def report(
    run: RunArgument,
    output: Annotated[Path, typer.Option(help="Output page, F.html.")],
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for every figure as PNG, SVG and PDF, and the data as CSV."),
    ] = None,
    published: Annotated[
        bool,
        typer.Option(
            "--published",
            help="Re-run all frames with the published method, and show both side by side.",
        ),
    ] = False,
    compared: ComparedOption = None,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Write a self-contained report of a run.

    It contains figures 9 to 17, errors, parameters and calibration. Figures 9 to 16 show
    single frames of the run. If the recording does not allow a figure, the report states the
    reason. Figures 9 and 13 need a simulated source, 10 and 14 any other.
    """
    path, comparison = chosen_run(run, compared, data, database)
    # Imported late, so that a missing run is reported before the plotting code is loaded.
    from app.reports.experiments import beside_published
    from app.reports.page import report_html
    from app.reports.report import make_report, write_figures
    from app.reports.result_files import write_file

    with progress_bar("report") as progress:
        made = make_report(path, progress, comparison=comparison)
    with progress_bar("re-running with the published method") as progress:
        if published:
            made = beside_published(made, path, progress, comparison)
    write_file(output, report_html(made).encode())
    if figures is not None:
        written = write_figures(made, figures)
        typer.echo(f"{len(written)} files in {figures}", err=True)
    missing = [str(each.number) for each in made.figures if each.figure is None]
    without = ""
    if missing:
        figures_missing = f"figure{'s' if missing[1:] else ''} {', '.join(missing)}"
        without = f", without {figures_missing}: the report states why"
    typer.echo(f"wrote {output}{without}", err=True)
