"""Report content: figures, tables and facts of one run, before the page layout."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.reports.comparison import Comparison, gather_compared
from app.reports.gathering import Gathered
from app.reports.pictures import pictures
from app.reports.report_figure import ReportFigure, Step
from app.reports.result_files import write_file
from app.reports.speed_figure import speed_figure
from observer.evaluation.speed_errors import SpeedErrors, identity_changes, speed_errors
from observer.figures import FORMATS, figure_bytes
from observer.recording.payloads import Incident, ParameterRevision, RunFacts
from observer.recording.reader import Recording


@dataclass(frozen=True, eq=False)
class Judged:
    """Experiment by one method, both by their names, with its speed errors."""

    experiment: str
    method: str
    gathered: Gathered
    errors: tuple[SpeedErrors, ...]


@dataclass(frozen=True, eq=False)
class Report:
    """Report on a run.

    Attributes:
        facts: of the run.
        unfinished: the recording has no end.
        frames: of the recording.
        duration_s: the run's length, see ``observer.recording.run_time``; None without a frame.
        statuses: frames by status.
        segments: first frame's time, by number.
        gathered: observations and truth.
        errors: of speed.
        changes: identity switches, by body.
        figures: in the paper's order.
        revisions: parameters.
        incidents: as recorded.
        judged: experiments within the run, each by several methods.
    """

    facts: RunFacts
    unfinished: bool
    frames: int
    duration_s: float | None
    statuses: Mapping[str, int]
    segments: Mapping[int, float]
    gathered: Gathered
    errors: tuple[SpeedErrors, ...]
    changes: Mapping[str, int]
    figures: tuple[ReportFigure, ...]
    revisions: tuple[ParameterRevision, ...]
    incidents: tuple[Incident, ...]
    judged: tuple[Judged, ...] = ()


def make_report(path: Path, progress: Step, *, comparison: Comparison | None = None) -> Report:
    """Read a recording and redo the paper's figures from it.

    Args:
        comparison: with truth that was applied to the run; None for the truth recorded with it.

    Raises:
        SourceError: it is no recording.
        CalibrationError: its calibration cannot be used.
        TruthError: the truth file cannot be read.
    """
    gathered = gather_compared(path, comparison)
    with Recording(path) as recording:
        facts, unfinished = recording.facts, recording.unfinished
        frames = recording.frames
        revisions, incidents = recording.parameter_revisions(), tuple(recording.incidents())
    statuses: dict[str, int] = {}
    segments: dict[int, float] = {}
    for line in gathered.lines:
        statuses[line["status"]] = statuses.get(line["status"], 0) + 1
        segments.setdefault(line["segment"], line["time"])
    return Report(
        facts=facts,
        unfinished=unfinished,
        frames=len(frames),
        duration_s=None if gathered.span is None else gathered.span[1] - gathered.span[0],
        statuses=statuses,
        segments=segments,
        gathered=gathered,
        errors=speed_errors(gathered.seen, gathered.true) if gathered.true else (),
        changes=identity_changes(gathered.seen),
        figures=(*pictures(path, gathered, facts, progress), _speeds(facts, gathered)),
        revisions=revisions,
        incidents=incidents,
    )


def write_figures(report: Report, folder: Path) -> list[Path]:
    """Write every figure in all formats, and the data of figures and tables as CSV.

    Raises:
        InputError: a file cannot be written.
    """
    written = []
    for each in report.figures:
        for format_ in FORMATS if each.figure is not None else ():
            assert each.figure is not None
            path = folder / f"{each.name}.{format_}"
            write_file(path, figure_bytes(each.figure, each.name, format_))
            written.append(path)
    tables = {
        "speeds.csv": _speed_rows(report.gathered),
        "errors.csv": _error_rows((("whole run", "as in the run", report.errors),)),
    }
    if report.judged:
        found = [(each.experiment, each.method, each.errors) for each in report.judged]
        tables["experiments_errors.csv"] = _error_rows(found)
        for part in report.judged:
            name = f"speeds, {part.experiment}, {part.method}"
            tables[f"{_file_name(name)}.csv"] = _speed_rows(part.gathered)
    for name, rows in tables.items():
        file = io.StringIO()
        csv.writer(file, lineterminator="\n").writerows(rows)
        write_file(folder / name, file.getvalue().encode())
        written.append(folder / name)
    facts = {"run": report.facts.id, "name": report.facts.name, "source": report.facts.source,
             "duration_s": report.duration_s, "versions": report.facts.versions}  # fmt: skip
    write_file(folder / "run.json", (json.dumps(facts, indent=2) + "\n").encode())
    return [*written, folder / "run.json"]


def _file_name(words: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_")


def _error_rows(
    found: Iterable[tuple[str, str, tuple[SpeedErrors, ...]]],
) -> list[list[Any]]:
    header = ["experiment", "method", *SpeedErrors.__dataclass_fields__]
    return [header] + [
        [experiment, method, *asdict(each).values()]
        for experiment, method, errors in found
        for each in errors
    ]


def _speed_rows(gathered: Gathered) -> list[list[Any]]:
    """Return one row per speed; an empty cell is unknown, and gaps of truth have empty cells."""
    rows: list[list[Any]] = []
    for motion in (*gathered.seen, *gathered.unmatched):
        for time, speed, std in zip(motion.times, motion.speeds, motion.stds, strict=True):
            rows.append(["observer", motion.body, motion.track, _cell(time), _cell(speed),
                         _cell(std)])  # fmt: skip
    for true in gathered.true:
        for time, speed in zip(true.times, true.speeds, strict=True):
            rows.append(["truth", true.body, "", _cell(time), _cell(speed), ""])
    for source, curves in (("commanded", gathered.commanded), ("encoder", gathered.encoder)):
        for curve in curves:
            for time, speed in zip(curve.times, curve.speeds, strict=True):
                rows.append([source, "", "", _cell(time), _cell(speed), ""])
    return [["source", "body", "track", "time_s", "speed_mps", "std_mps"], *rows]


def _cell(value: float) -> str:
    # NaN is not equal to itself.
    return repr(float(value)) if value == value else ""


def _speeds(facts: RunFacts, gathered: Gathered) -> ReportFigure:
    place = ("figure17", "17", "Speed of the dynamic obstacle")
    if not (gathered.seen or gathered.unmatched or gathered.true):
        missing = (
            "No motion was detected and there is no ground truth, so there is no speed to plot."
        )
        return ReportFigure(*place, "", None, "chart", missing)
    unknown = [
        word
        for word, known in (
            ("truth", gathered.true),
            ("commands", gathered.commanded),
            ("encoders", gathered.encoder),
        )
        if not known
    ]
    without = f" The recording contains no {', no '.join(unknown)}." if unknown else ""
    caption = (
        "Each track with its 95 % interval; a dot and the number (segment:track) mark the start of "
        f"a track. Lines are interrupted at gaps.{without}"
    )
    figure = speed_figure([(facts.name or facts.id, gathered)])
    return ReportFigure(*place, caption, figure, "chart")
