"""Report content: figures, tables and facts of one run, before the page layout."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from matplotlib.figure import Figure

from app.reports.comparison import Comparison, gather_compared
from app.reports.drawing import FORMATS, figure_bytes
from app.reports.gathering import Gathered
from app.reports.moments import CANDIDATES, Moment, Moments, most_significant
from app.reports.picture_figures import (
    cloud_figure,
    detection_figure,
    false_points_figure,
    flow_figure,
    transformation_figure,
)
from app.reports.speed_figure import speed_figure
from app.reports.whole_files import write_file
from observer.errors import DynamicObserverError
from observer.evaluation.speed_errors import SpeedErrors, identity_changes, speed_errors
from observer.recording.payloads import Incident, ParameterRevision, RunFacts
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource

# Sources of a simulated world, as in the paper's left-hand figures; others are real cameras.
_SIMULATED = ("simulated", "coppeliasim")
Step = Callable[[int, int | None], None]


@dataclass(frozen=True, eq=False)
class ReportFigure:
    """Figure of the paper, redone or missing.

    Attributes:
        name: for files.
        number: as in the paper.
        title, caption: for people.
        figure: None where ``missing`` gives the reason in a sentence.
        kind: ``chart`` for lines and text, ``picture`` for mostly images.
    """

    name: str
    number: str
    title: str
    caption: str
    figure: Figure | None
    kind: Literal["chart", "picture"] = "picture"
    missing: str = ""


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
        duration_s, frames: of the recording.
        statuses: frames by status.
        segments: first frame's time, by number.
        gathered: observations and truth.
        errors: of speed.
        changes: of identity, by body.
        figures: in the paper's order.
        revisions: parameters.
        incidents: as recorded.
        judged: experiments within the run, each by several methods.
    """

    facts: RunFacts
    unfinished: bool
    frames: int
    duration_s: float
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
    pictures = _pictures(path, gathered, facts, progress)
    statuses: dict[str, int] = {}
    segments: dict[int, float] = {}
    for line in gathered.lines:
        statuses[line["status"]] = statuses.get(line["status"], 0) + 1
        segments.setdefault(line["segment"], line["time"])
    return Report(
        facts=facts,
        unfinished=unfinished,
        frames=len(frames),
        duration_s=frames[-1].received - frames[0].received if frames else 0.0,
        statuses=statuses,
        segments=segments,
        gathered=gathered,
        errors=speed_errors(gathered.seen, gathered.true) if gathered.true else (),
        changes=identity_changes(gathered.seen),
        figures=(*pictures, _speeds(facts, gathered)),
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
             "versions": report.facts.versions}  # fmt: skip
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


def _pictures(
    path: Path, gathered: Gathered, facts: RunFacts, progress: Step
) -> tuple[ReportFigure, ...]:
    simulated = str(facts.info.get("kind")) in _SIMULATED
    nine, thirteen = ("9", "13") if simulated else ("10", "14")
    places = (
        (f"figure{nine}", nine, "Image transformation"),
        ("figure11", "11", "Optic flow after image transformation"),
        (f"figure{thirteen}", thirteen, "Detected dynamic obstacle"),
        ("figure15", "15", "Points that do not move, taken for moving"),
        ("figure16", "16", "Detected obstacle in the 3D point cloud"),
    )
    try:
        source = RecordingSource(path)
    except DynamicObserverError as error:
        return tuple(ReportFigure(*each, "", None, missing=f"{error}.") for each in places)
    try:
        moments = Moments(source, gathered)
        position = moments.most_significant()
        if position is None:
            missing = "Nothing was seen to move in this run, so no frame could be chosen."
            return tuple(ReportFigure(*each, "", None, missing=missing) for each in places)
        progress(1, 5)
        published = moments.published(position)
        progress(2, 5)
        own = moments.own(position)
        progress(3, 5)
        false = moments.most_false()
        progress(4, 5)
        false_own = None if false is None else moments.own(false.position)
        progress(5, 5)
    finally:
        source.close()
    return tuple(
        ReportFigure(*place, caption, figure, missing=missing)
        for place, (caption, figure, missing) in zip(
            places,
            (
                _transformation(published),
                _flow(published),
                _detection(own),
                _false_points(false, false_own),
                _cloud(own),
            ),
            strict=True,
        )
    )


_Made = tuple[str, Figure | None, str]
_NOT_OBSERVED = "The images of the chosen frame could not be observed once more."


def _transformation(moment: Moment | None) -> _Made:
    if moment is None or "warped_left" not in moment.trace:
        return "", None, _NOT_OBSERVED
    dt_ms = 1e3 * (moment.trace["time"] - moment.trace["previous_time"])
    return (
        f"{_chosen(moment)} The image at t+dt, {dt_ms:.0f} ms later, is transformed into the "
        f"frame of the image at t by the affine map of the method as published; black is where "
        f"it does not reach.",
        transformation_figure(moment), "",
    )  # fmt: skip


def _flow(moment: Moment | None) -> _Made:
    if moment is None:
        return "", None, _NOT_OBSERVED
    return (
        f"{_chosen(moment)} From each feature of the image at t to its place in the transformed "
        f"image of t+dt: blue ones count as standing, red ones as moving.",
        flow_figure(moment), "",
    )  # fmt: skip


def _detection(moment: Moment | None) -> _Made:
    if moment is None:
        return "", None, _NOT_OBSERVED
    return (
        f"{_chosen(moment)} Green stars are the feature points that move, the yellow box is the "
        f"detected obstacle with its number and speed, as the run reported it.",
        detection_figure(moment), "",
    )  # fmt: skip


def _false_points(published: Moment | None, own: Moment | None) -> _Made:
    if published is None or own is None:
        return "", None, _NOT_OBSERVED
    moving = "truly moves" if published.by_truth else "the run reported as moving"
    return (
        f"Frame {published.line['frame']}, t = {published.line['time']:.2f} s: of up to "
        f"{CANDIDATES} frames spread over those in which something moving was seen, the one with "
        f"most false points by the method as published. Green stars count as moving; red circles "
        f"are those on nothing that {moving}. Left the affine model of the preset paper, right "
        f"the same frame by the {own.model} model of this run.",
        false_points_figure(published, own), "",
    )  # fmt: skip


def _cloud(moment: Moment | None) -> _Made:
    obstacle = None if moment is None else most_significant(moment.line)
    if moment is None or obstacle is None:
        return "", None, _NOT_OBSERVED
    if moment.line["pose"] is None or obstacle["position"] is None:
        return "", None, "The camera's pose was not known in this frame."
    x, y, z = obstacle["position"]
    return (
        f"{_chosen(moment)} The stereo camera is at the origin (triangle); the red box is "
        f"obstacle {obstacle['id']}, {obstacle['range']:.2f} m away, at "
        f"({x:.2f}, {y:.2f}, {z:.2f}) m in the world of its segment.",
        cloud_figure(moment, obstacle), "",
    )  # fmt: skip


def _chosen(moment: Moment) -> str:
    return (
        f"Frame {moment.line['frame']}, t = {moment.line['time']:.2f} s, the one with the most "
        f"significant detection."
    )


def _speeds(facts: RunFacts, gathered: Gathered) -> ReportFigure:
    place = ("figure17", "17", "Speed of the dynamic obstacle")
    if not (gathered.seen or gathered.unmatched or gathered.true):
        missing = "Nothing was seen to move, and no truth is known, so there is no speed to draw."
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
    without = f" The recording holds no {', no '.join(unknown)}." if unknown else ""
    caption = (
        f"Each track of the observer with its band of 95 %, a dot and its number "
        f"(segment:track) where an identity begins. Lines end at gaps.{without}"
    )
    figure = speed_figure([(facts.name or facts.id, gathered)])
    return ReportFigure(*place, caption, figure, "chart")
