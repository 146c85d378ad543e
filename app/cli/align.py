"""``dynamic-observer align``: align motion capture with a recorded run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.finite import finite
from app.cli.run_choice import RunArgument
from app.cli.storage_options import DataOption, chosen_settings
from app.cli.truth_options import (
    AnglesOption,
    CameraOnBodyOption,
    IgnoreOption,
    ObserverOption,
    RateOption,
    body_camera,
    body_roles,
)
from observer.errors import InputError
from observer.truth.files.known import names_in_words

# Seconds: tolerance of the time offset given with --expect.
_ROUGHLY_S = 2.0

if TYPE_CHECKING:
    from observer.geometry import Pose
    from observer.recording.payloads import RunFacts
    from observer.truth.alignment.choices import AlignmentChoices


def align(
    run: RunArgument,
    output: Annotated[
        Path, typer.Option(help="Output for report and chart, option --compared; JSON.")
    ],
    truth: Annotated[
        Path | None,
        typer.Option(
            help=f"Motion capture ({names_in_words()}), or the recording of a run with live motion "
            "capture. Default: the motion capture received live with this run."
        ),
    ] = None,
    name: Annotated[str | None, typer.Option(help="Label of the ground truth.")] = None,
    observer: ObserverOption = None,
    ignore: IgnoreOption = None,
    match: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TRACK=BODY",
            help="Assign a track to a body, as in 0:3=cart, or to none, as in 0:3=; repeatable.",
        ),
    ] = None,
    expect: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            callback=finite,
            help="For periodic motion: the offset to add to the ground truth's times, correct to "
            f"within {_ROUGHLY_S:g} s.",
        ),
    ] = None,
    camera_on_body: CameraOnBodyOption = None,
    rate: RateOption = None,
    angles: AnglesOption = None,
    speeds: Annotated[
        Path | None, typer.Option(help="Also write the true speeds at the frames of the run; JSON.")
    ] = None,
    data: DataOption = None,
) -> None:
    """Align motion capture with a run.

    Finds the time offset, the room frame, and which tracks match which bodies.
    """
    from app.contract.values import plain
    from app.reports.comparison import (
        ComparedRecording,
        Comparison,
        TruthFile,
        alignment_facts,
        recorded_capture,
        true_speeds,
    )
    from app.reports.result_files import write_file
    from observer.recording.reader import Recording
    from observer.recording.run_folder import find_recording
    from observer.truth.alignment.alignment import align as solve
    from observer.truth.alignment.observed import ObservedRun

    T_body_camera = body_camera(camera_on_body)
    path = find_recording(run, chosen_settings(data=data).data)
    file = None if truth is None else TruthFile(truth, name or truth.name, rate, angles)
    with Recording(path) as recording:
        if file is not None and not file.needs_alignment:
            comparison = Comparison(None, file)
        else:
            capture = recorded_capture(recording) if file is None else file.capture()
            # Ignored bodies need not be in the file.
            ignored = [body for body in ignore or [] if body in capture.bodies]
            choices = _choices(
                recording.facts, observer, ignored, match or [], expect, T_body_camera
            )
            observed = ObservedRun.of_lines(recording.lines())
            comparison = Comparison(solve(observed, capture, choices), file)
    facts = None if comparison.alignment is None else plain(alignment_facts(comparison.alignment))
    result = comparison.as_dict() | {"words": comparison.words, "facts": facts}
    write_file(output, json.dumps(result, allow_nan=False).encode())
    if speeds is not None:
        with ComparedRecording(path, comparison) as compared:
            rows = true_speeds(compared)
        write_file(speeds, json.dumps(rows, allow_nan=False).encode())
    typer.echo(comparison.words, err=True)
    for note in () if comparison.alignment is None else comparison.alignment.notes:
        typer.echo(note, err=True)


def _choices(
    facts: RunFacts,
    observer: str | None,
    ignored: list[str],
    matches: list[str],
    expected_s: float | None,
    T_body_camera: Pose | None,
) -> AlignmentChoices:
    from observer.mount import CameraMount
    from observer.rig.rig_file import read_rig
    from observer.truth.alignment.choices import AlignmentChoices
    from observer.truth.alignment.observed import TrackKey

    found: dict[TrackKey, str | None] = {}
    for text in matches:
        track, equals, body = text.partition("=")
        if not equals:
            raise InputError(f"give a match as TRACK=BODY, for example 0:3=cart, not {text[:60]}")
        found[TrackKey.parse(track)] = body or None
    more: dict[str, Any] = {"T_body_camera": T_body_camera}
    if expected_s is not None:
        more["search"] = (expected_s - _ROUGHLY_S, expected_s + _ROUGHLY_S)
    if facts.mount is not None:
        more["mount"] = CameraMount(**facts.mount)  # type: ignore[arg-type]
    if facts.rig_yaml is not None and observer is not None:
        more["T_body_base"] = read_rig(facts.rig_yaml, "rig.yaml").T_body_base.get(observer)
    return AlignmentChoices(roles=body_roles(observer, ignored), matches=found, **more)
