"""``dynamic-observer frames``: what was found in each frame of a run, for drawing it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from app.cli.run_choice import ComparedOption, RunArgument, chosen_run
from app.cli.storage_options import DatabaseOption, DataOption


def frames(
    run: RunArgument,
    output: Annotated[Path, typer.Option(help="The JSON file to write.")],
    compared: ComparedOption = None,
    data: DataOption = None,
    database: DatabaseOption = None,
) -> None:
    """Write the results of each frame as JSON.

    Boxes, speeds, and counts compared with ground truth.
    """
    from app.contract.values import plain
    from app.reports.comparison import ComparedRecording
    from app.reports.result_files import write_file
    from app.workers.methods.frames import run_frames
    from observer.recording.reader import Recording
    from observer.recording.run_times import RunTimes
    from observer.truth.alignment.aligned import AlignedTruth

    path, comparison = chosen_run(run, compared, data, database)
    opened = Recording(path) if comparison is None else ComparedRecording(path, comparison)
    with opened as recording:
        truth, alignment = recording.truth(), comparison and comparison.alignment
        capture = recording.capture() if alignment else None
        if alignment and capture is not None:
            aligned = AlignedTruth(capture, alignment)
            truth = RunTimes(recording.frames).truth([(0, aligned)])
        found = run_frames(recording, truth)
    write_file(output, json.dumps(plain(found), allow_nan=False).encode())
    typer.echo(f"wrote {output}", err=True)
