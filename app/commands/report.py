"""``dynamic-observer report``: the paper's figures redone from a run, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.commands.progress import progress_bar
from app.commands.storage_options import DatabaseOption, DataOption, storage_settings

if TYPE_CHECKING:
    from observer.truth.alignment.result import Alignment


def report(
    run: Annotated[str, typer.Argument(help="A run's id, or a recording.mcap.")],
    output: Annotated[Path, typer.Option(help="The page to write, F.html.")],
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for each figure as PNG, SVG and PDF, and the data as CSV."),
    ] = None,
    published: Annotated[
        bool,
        typer.Option(
            "--published",
            help="Observe all frames once more by the method as published, and show both beside "
            "each other.",
        ),
    ] = False,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Write one self-contained page: figures 9-11 and 13-17, errors, parameters, calibration."""
    from app.reporting.drawing import write_file
    from app.reporting.experiments import beside_published
    from app.reporting.page import report_html
    from app.reporting.report import make_report, write_figures

    path, alignment = _found(run, data, database)
    with progress_bar("report") as progress:
        made = make_report(path, alignment=alignment, progress=progress)
    with progress_bar("observing as published") as progress:
        if published:
            made = beside_published(made, path, progress)
    write_file(output, report_html(made).encode())
    if figures is not None:
        written = write_figures(made, figures)
        typer.echo(f"{len(written)} files in {figures}", err=True)
    missing = [f"figure {each.number}" for each in made.figures if each.figure is None]
    without = f", without {', '.join(missing)}: the page says why" if missing else ""
    typer.echo(f"{output} is written{without}", err=True)


def _found(
    run: str, data: Path | None, database: str | None
) -> tuple[Path, Alignment | None]:
    """The recording, and the alignment that was kept with the run."""
    if "/" in run or run.endswith(".mcap"):
        return Path(run), None
    from app.storage import Storage
    from observer.recording.run_folder import find_recording
    from observer.truth.alignment.result import Alignment

    settings = storage_settings(data, database)
    path = find_recording(run, settings.data.expanduser().absolute())
    with Storage(settings.database_location, folder=settings.data) as storage:
        record = storage.get_run(path.parent.name)
    kept = None if record is None else record.alignment
    return path, None if kept is None else Alignment.of_dict(kept)
