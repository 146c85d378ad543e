"""``dynamic-observer observe``: run the method over a source at full speed."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import IO, Annotated, Literal

import typer

from app.cli.assignments import chosen_parameters
from app.cli.keeping import Keeper, keeping
from app.cli.output import whole_file
from app.cli.progress import ProgressCallback, progress_bar
from observer.calibration.formats.known import tools_in_words
from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import Size
from observer.calibration.formats.units import UNIT_HELP, UnitUnclear, parse_unit
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, InputError
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.opening import open_source
from observer.sources.contract import NoFrame, SkippedFrame, Source


def observe(
    source: Annotated[
        str,
        typer.Argument(
            help="simulated:SCENARIO, video:LEFT,RIGHT, coppeliasim:HOST:PORT, cameras, a folder "
            "of stereo images or a recording.mcap."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option(help="File for the JSON lines, one per frame; else stdout.")
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
            help="What lengths in --calibration are in, where it is not the format's own: "
            f"{UNIT_HELP}.",
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", help="NAME=VALUE of a parameter; may be given more than once."),
    ] = None,
    preset: Annotated[str, typer.Option(help="Parameters to start from: default or paper.")] = (
        "default"
    ),
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after this many frames.")] = None,
    tentative: Annotated[
        bool,
        typer.Option(
            "--tentative",
            help="Write obstacles that are not confirmed, too; their ids, below zero, are "
            "provisional.",
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
    """Observe a source from its first frame to its last and write one JSON line per frame."""
    parameters = chosen_parameters(preset, assignments or [])
    if unit is not None and not calibration:
        raise InputError(
            "--unit says what --calibration FILE is in; name the file, or leave it out"
        )
    found = open_source(source)
    opened = found.source
    try:
        used = (
            _read_calibration(calibration, (opened.info.width, opened.info.height), unit)
            if calibration
            else opened.calibration
        )
        if not calibration and found.calibration_notes:
            typer.echo(f"calibration: {'; '.join(found.calibration_notes)}", err=True)
        if used is None:
            raise CalibrationError(
                f"{source} brings no calibration; name one with --calibration FILE "
                f"(OpenCV YAML with K1 D1 K2 D2 R T, or that of another tool)"
            )
        observer = Observer(used, parameters, mount=opened.info.mount)
        keeper = keeping(
            opened.info, found.truth, used, parameters, preset,
            record=record, images=record_images, video=video,
        )  # fmt: skip
        with (
            nullcontext(sys.stdout) if output is None else whole_file(output) as file,
            keeper as kept,
            progress_bar(f"observing {source}") as progress,
        ):
            skipped = _observe_all(opened, observer, file, progress, frames, tentative, kept)
        if video is not None:
            typer.echo(f"{video}: {kept.video_told}", err=True)
    finally:
        opened.close()
    if skipped:
        shown = "; ".join(f"{s.index}: {s.reason}" for s in skipped[:5])
        more = f"; and {len(skipped) - 5} more" if len(skipped) > 5 else ""
        typer.echo(f"skipped {len(skipped)} frame(s): {shown}{more}", err=True)


def _read_calibration(names: list[str], size: Size, unit: str | None) -> StereoCalibration:
    """Read the calibration from these files for images of this size; log decisions to stderr.

    Args:
        unit: as ``parse_unit`` takes it, or None for the format's own.
    """
    # A file name may contain a comma.
    paths = [
        path
        for name in names
        for path in ([name] if Path(name).exists() else filter(None, name.split(",")))
    ]
    try:
        read = read_any(
            [named_file(path) for path in paths],
            unit=None if unit is None else parse_unit(unit),
            expected_size=size,
        )
    except UnitUnclear as error:
        raise error.asking("say --unit {}") from None
    typer.echo(f"calibration: {'; '.join((read.format, *read.notes))}", err=True)
    return read.calibration


def _observe_all(
    source: Source,
    observer: Observer,
    file: IO[str],
    progress: ProgressCallback,
    limit: int | None,
    tentative: bool,
    kept: Keeper,
) -> list[SkippedFrame]:
    """Write one line per readable frame; return the frames that could not be read."""
    skipped: list[SkippedFrame] = []
    observed = 0
    trouble: str | None = None
    while limit is None or observed < limit:
        frame = source.read()
        if frame is None:
            break
        if isinstance(frame, SkippedFrame):
            skipped.append(frame)
            kept.skipped(frame)
            continue
        if isinstance(frame, NoFrame):
            # Told once as long as it stays the same.
            if frame.trouble not in (None, trouble):
                typer.echo(frame.trouble, err=True)
            trouble = frame.trouble
            kept.waited()
            continue
        kept.frame(frame)
        observation = observer.observe(frame)
        line = observation_line(observation, tentative=tentative)
        file.write(json.dumps(line, allow_nan=False) + "\n")
        kept.observed(frame, observation, line)
        observed += 1
        progress(observed, limit or source.info.frame_count)
    if observed == 0:
        reasons = f": {skipped[0].reason}" if skipped else ""
        raise InputError(f"{source.info.spec} has no frame that could be read{reasons}")
    return skipped
