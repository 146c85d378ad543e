"""``dynamic-observer simulate``: write a simulated scenario as a stereo folder with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar
from observer.simulation.export import export_stereo_folder


def simulate(
    scenario: Annotated[str, typer.Argument(help="Name of a scenario, or a YAML file of one.")],
    output: Annotated[Path, typer.Option(help="Folder to write; must be new or empty.")],
    seed: Annotated[int, typer.Option(min=0, help="Changes textures, layout and motion.")] = 0,
) -> None:
    """Write left/, right/, times.txt, calibration.yaml and truth.csv of a scenario."""
    with progress_bar(f"rendering {scenario}") as progress:
        export_stereo_folder(scenario, seed, output, progress)
    typer.echo(f"wrote {output}", err=True)
