"""``dynamic-observer simulate``: render a scenario into a stereo folder, with ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.progress import progress_bar


def simulate(
    scenario: Annotated[str, typer.Argument(help="Name of a scenario, or a YAML file of one.")],
    output: Annotated[Path, typer.Option(help="Folder to write; must be new or empty.")],
    seed: Annotated[int, typer.Option(min=0, help="Changes textures, layout and motion.")] = 0,
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")] = None,
) -> None:
    """Render a scenario into a stereo folder.

    It contains left/, right/, times.txt, calibration.yaml and truth.csv.
    """
    with progress_bar(f"rendering {scenario}") as progress:
        # Importing it loads OpenCV, which takes a second.
        from observer.simulation.export import export_stereo_folder

        export_stereo_folder(scenario, seed, output, progress, frames)
    typer.echo(f"wrote {output}", err=True)
