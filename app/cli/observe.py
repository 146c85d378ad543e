"""``dynamic-observer observe``: run the method over a source at full speed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from app.cli.progress import progress_bar
from observer.calibration.formats.known import UNIT_HELP, tools_in_words
from observer.errors import InputError


def observe(
    source: Annotated[
        str,
        typer.Argument(
            help="simulated:SCENARIO, video:LEFT,RIGHT, coppeliasim:HOST:PORT, cameras, a folder "
            "of stereo images or a recording.mcap."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option(help="File for the JSON lines, one per frame. [default: stdout]")
    ] = None,
    calibration: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE[,FILE]",
            help=f"Calibration used instead of the source's own: {tools_in_words()}, recognised by "
            "content. Pairs of files are joined by a comma, or given one by one.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help="Unit of the lengths in --calibration, if not the default of the format: "
            f"{UNIT_HELP}.",
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Value of a parameter; repeatable."),
    ] = None,
    preset: Annotated[str, typer.Option(help="Parameters to start from: default or paper.")] = (
        "default"
    ),
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")] = None,
    tentative: Annotated[
        bool,
        typer.Option(
            "--tentative",
            help="Also write unconfirmed obstacles; their ids are negative and provisional.",
        ),
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(metavar="F.mcap", help="Also record the run as it is observed."),
    ] = None,
    record_images: Annotated[
        Literal["none", "jpeg", "lossless"], typer.Option(help="Which images are recorded.")
    ] = "jpeg",
    video: Annotated[
        Path | None,
        typer.Option(metavar="F.mp4", help="Also write a video of what is found."),
    ] = None,
) -> None:
    """Process a source, one JSON line per frame.

    Every frame is processed, as fast as the computer can.
    """
    if unit is not None and not calibration:
        raise InputError("--unit applies to --calibration FILE; give the file, or omit --unit")
    with progress_bar(f"opening {source}") as progress:
        # Importing it loads OpenCV and the method, which takes a second.
        from app.cli.observing import Observing

        Observing(
            source=source,
            output=output,
            calibration=calibration or [],
            unit=unit,
            assignments=assignments or [],
            preset=preset,
            frames=frames,
            tentative=tentative,
            record=record,
            record_images=record_images,
            video=video,
        ).run(progress)
