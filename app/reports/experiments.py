"""Experiments: stretches of a run, and one run observed by two methods."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.reports.comparison import Comparison, gather_compared
from app.reports.gathering import Gathered
from app.reports.report import Judged, Report
from app.reports.report_figure import ReportFigure, Step
from app.reports.speed_figure import speed_figure
from app.reports.stretches import during
from observer.evaluation.speed_errors import speed_errors
from observer.jsonl import observation_line
from observer.parameters import preset
from observer.recording.reader import Recording
from observer.recording.replay import replay, replay_revisions
from observer.recording.run_time import RunTime
from observer.recording.source import RecordingSource


@dataclass(frozen=True)
class Experiment:
    """Stretch of a run that is an experiment.

    Attributes:
        title: for people.
        began, ended: host's monotonic clock, seconds.
    """

    title: str
    began: float
    ended: float


def observed_as_published(
    path: Path, progress: Step, comparison: Comparison | None = None
) -> Gathered:
    """Re-run the run's frames by the method as published.

    Args:
        comparison: with truth that was applied to the run.

    Raises:
        SourceError: the recording holds no images.
    """
    with closing(RecordingSource(path)) as source:
        revisions = replay_revisions(source.recording, preset("paper").flat())
        lines = []
        for observation in replay(source, revisions):
            lines.append(observation_line(observation))
            progress(len(lines), source.info.frame_count)
    return gather_compared(path, comparison, lines)


def beside_published(
    report: Report, path: Path, progress: Step, comparison: Comparison | None = None
) -> Report:
    """Report the whole run as one experiment, by its own method and by the published one.

    Args:
        comparison: as used for the report.

    Raises:
        SourceError: the recording holds no images.
    """
    published = observed_as_published(path, progress, comparison)
    name = report.facts.name or report.facts.id
    errors = speed_errors(published.seen, published.true) if published.true else ()
    return with_experiments(
        report,
        (
            Judged(name, "as in the run", report.gathered, report.errors),
            Judged(name, "affine, as published", published, errors),
        ),
    )


def judged(path: Path, gathered: Gathered, experiment: Experiment, method: str) -> Judged:
    """Judge one experiment: its part of a run, and the errors."""
    with Recording(path) as recording:
        frames = recording.frames
    received = np.array([frame.received for frame in frames])
    clock = RunTime()
    times = np.array([clock.add_recorded(frame) for frame in frames])
    begin, end = np.interp((experiment.began, experiment.ended), received, times)
    part = during(gathered, float(begin), float(end))
    return Judged(experiment.title, method, part, speed_errors(part.seen, part.true))


def with_experiments(report: Report, found: tuple[Judged, ...]) -> Report:
    """Return the report with figure 17 by experiment and method, and their errors side by side."""
    charts = [(f"{each.experiment}: {each.method}", each.gathered) for each in found]
    highest = max((_highest(each.gathered) for each in found), default=0.0)
    figure = ReportFigure(
        "figure17_experiments",
        "17",
        "Speed of the dynamic obstacle by both methods",
        "As estimated in the run, and the same frames re-run with the published method (preset "
        "paper, affine). Speeds off the chart are still included in the table and in the data.",
        speed_figure(charts, 2.0 * highest if highest > 0 else None),
        "chart",
    )
    return replace(report, figures=(*report.figures, figure), judged=found)


def _highest(gathered: Gathered) -> float:
    return max((float(np.nanmax(each.speeds, initial=0.0)) for each in gathered.true), default=0.0)
