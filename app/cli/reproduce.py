"""``dynamic-observer reproduce``: reproduce the paper's figures from both simulated experiments."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.progress import progress_bar
from observer.number_format import format_number

if TYPE_CHECKING:
    from app.reports.report import Report

PROGRAMMES = ("figure17_a", "figure17_b")


def reproduce(
    output: Annotated[Path, typer.Option(help="Output folder.")],
) -> None:
    """Reproduce the paper's figures.

    Both experiments of figure 17 are run in the simulated lab. A separate server drives and
    records them, which takes about a minute; then the same frames are re-run with the
    published method. The robots are stopped when frames come too late, as on a busy computer:
    both experiments are then repeated, a limited number of times.
    """
    from app.reports.experiments import observed_as_published
    from app.reports.page import report_html
    from app.reports.report import write_figures
    from app.reports.reproduction import play_experiments, reproduction_report
    from app.reports.result_files import write_file
    from observer.motion_profiles.library import library_text, load_profile

    for name in PROGRAMMES:
        # Done first, to report an unwritable folder before anything is driven.
        write_file(output / "programmes" / f"{name}.yaml", library_text(name).encode())
    played = play_experiments(
        output / "recording.mcap",
        [load_profile(name) for name in PROGRAMMES],
        tell=lambda sentence: typer.echo(sentence, err=True),
    )
    with progress_bar("re-running with the published method") as progress:
        published = observed_as_published(played.recording, progress)
    with progress_bar("figures") as progress:
        report = reproduction_report(played, published, progress)
    write_file(output / "report.html", report_html(report).encode())
    written = write_figures(report, output / "figures")
    plain = {
        "experiments": [each.title for each in played.experiments],
        # Failed drives are not part of the experiments, only of how they were made.
        "ended_early": played.interrupted,
    }
    write_file(output / "experiments.json", (json.dumps(plain, indent=2) + "\n").encode())
    _tell_errors(report)
    typer.echo(
        f"{output / 'report.html'} is written, and {len(written)} files in {output / 'figures'}",
        err=True,
    )


def _tell_errors(report: Report) -> None:
    for each in report.judged:
        whole = each.errors[0]
        said = (
            "no matching detection"
            if whole.rmse_mps is None or whole.bias_mps is None
            else f"RMSE {whole.rmse_mps:.3f} m/s, "
            f"bias {format_number(whole.bias_mps, 3, signed=True)} m/s over {whole.samples} samples"
        )
        typer.echo(f"{each.experiment}, {each.method}: {said}", err=True)
