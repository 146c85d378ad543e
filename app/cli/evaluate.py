"""``dynamic-observer evaluate``: compare the tracks of ``observe`` with ground truth."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.truth_options import (
    AnglesOption,
    CameraOnBodyOption,
    IgnoreOption,
    ObserverOption,
    RateOption,
    body_camera,
    body_roles,
)
from observer.evaluation.choices import LAB, ROAD
from observer.truth.files.known import names_in_words

if TYPE_CHECKING:
    from observer.truth.opening import OpenedTruth

_NO_SIZE = (
    "the image size is unknown, because there is no calibration.yaml next to the ground truth: "
    "boxes are not clipped to the image, and an obstacle that is less than half visible never "
    "counts as in sight, even if it fills the image"
)


def evaluate(
    tracks: Annotated[Path, typer.Argument(help="JSON lines written by observe.")],
    truth: Annotated[
        Path,
        typer.Option(
            help="truth.csv of the same frames; or motion capture, which is aligned first: "
            f"{names_in_words()}."
        ),
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON on stdout.")
    ] = False,
    road: Annotated[
        bool,
        typer.Option(
            "--road",
            help=f"For roads: match within {ROAD.gate_m:g} m instead of {LAB.gate_m:g} m, with "
            "matching range and speed classes.",
        ),
    ] = False,
    observer: ObserverOption = None,
    ignore: IgnoreOption = None,
    camera_on_body: CameraOnBodyOption = None,
    rate: RateOption = None,
    angles: AnglesOption = None,
) -> None:
    """Compare tracks with ground truth.

    Prints recall, false obstacles, and errors of position and velocity.
    """
    # Importing them loads SciPy, which takes a second.
    from observer.evaluation.breakdown import break_down, breakdown_tables
    from observer.evaluation.evaluate import summarise
    from observer.evaluation.lines import read_both
    from observer.evaluation.results import listed
    from observer.evaluation.tally import tally
    from observer.truth.alignment.choices import AlignmentChoices
    from observer.truth.opening import open_truth

    scale = ROAD if road else LAB
    lines, plain = read_both(tracks)
    choices = AlignmentChoices(
        roles=body_roles(observer, ignore or []), T_body_camera=body_camera(camera_on_body)
    )
    opened = open_truth(truth, plain, choices, rate_hz=rate, angles=angles)
    # Only truth.csv knows boxes in the image.
    size = _image_size(truth) if opened.capture is None else None
    for sentence in _sentences(opened):
        typer.echo(sentence, err=True)
    if size is None and any(
        body.box_px is not None for line in lines for body in opened.truth.bodies(line.time)
    ):
        typer.echo(_NO_SIZE, err=True)
    counted = tally(lines, opened.truth, scale.gate_m, image_size=size)
    result, classes = summarise([counted]), break_down([counted], scale)
    if as_json:
        figures: dict[str, Any] = {
            **result.as_dict(),
            "breakdown": asdict(classes),
            **listed(tuple(counted.false)),
        }
        if opened.alignment is not None:
            figures["alignment"] = opened.alignment.as_dict()
        typer.echo(json.dumps(figures, indent=2, allow_nan=False))
    else:
        typer.echo(f"{result.markdown()}\n{breakdown_tables({'': classes})}".rstrip())


def _image_size(truth: Path) -> tuple[int, int] | None:
    """Return the image size from the calibration next to a truth file; None without one."""
    from observer.calibration.formats.opencv_file import read_noted_calibration

    file = truth.with_name("calibration.yaml")
    if not file.is_file():
        return None
    calibration, _ = read_noted_calibration(file)
    return calibration.width, calibration.height


def _sentences(opened: OpenedTruth) -> list[str]:
    """Describe how the truth file was read and aligned; for people, on stderr."""
    if opened.capture is None or opened.alignment is None:
        return []
    return [
        f"ground truth: {opened.capture.format}",
        *opened.capture.notes,
        opened.alignment.time.words,
        *opened.alignment.notes,
    ]
