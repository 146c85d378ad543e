"""Stretches of a run by themselves, and the same frames by the method as published."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.reporting.experiments import (
    Experiment,
    beside_published,
    during,
    judged,
)
from app.reporting.page import report_html
from app.reporting.report import Report, write_figures
from app.reporting.reproduction import Played, reproduction_report
from observer.recording.reader import Recording


@pytest.fixture(scope="session")
def both(recording: Path, report: Report) -> Report:
    """The run beside the method as published."""
    return beside_published(report, recording, lambda _done, _of: None)


@pytest.fixture(scope="session")
def experiment(recording: Path) -> Experiment:
    """The last eight frames of the run."""
    with Recording(recording) as opened:
        frames = opened.frames
    return Experiment("late", "Late in the run", frames[4].received, frames[-1].received + 1.0)


def test_only_what_belongs_to_an_experiment_is_judged(
    recording: Path, report: Report, experiment: Experiment
) -> None:
    part = judged(recording, report.gathered, experiment, "rigid")
    (true,) = part.gathered.true
    whole = report.gathered.true[0]
    assert true.times.tolist() == whole.times[4:].tolist()
    assert len(true.directions) == len(true.times)
    (seen,) = part.gathered.seen
    assert seen.frame_times.min() >= whole.times[4]
    assert part.errors[0].samples <= report.errors[0].samples
    assert part.gathered.commanded[0].times.min() >= whole.times[4]
    assert during(report.gathered, 100.0, 200.0).seen == ()


def test_the_same_frames_are_observed_by_the_method_as_published(
    report: Report, both: Report, tmp_path: Path
) -> None:
    own, published = both.judged
    assert len(published.gathered.lines) == len(report.gathered.lines)
    assert published.gathered.true[0].speeds == pytest.approx(report.gathered.true[0].speeds)
    # The lines are another method's, not those of the recording.
    assert [line["obstacles"] for line in published.gathered.lines] != [
        line["obstacles"] for line in report.gathered.lines
    ]
    assert own.errors == report.errors
    html = report_html(both)
    assert "a &lt;short&gt; run: affine, as published" in html
    assert "By experiment and method" in html
    write_figures(replace(both, figures=both.figures[-1:]), tmp_path)
    with (tmp_path / "experiments_errors.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["group"] == "all"]
    assert [row["method"] for row in rows] == ["as in the run", "affine, as published"]
    assert float(rows[0]["rmse_mps"]) == own.errors[0].rmse_mps
    speeds = tmp_path / "speeds_a_short_run_as_in_the_run.csv"
    with speeds.open() as file:
        times = [float(r["time_s"]) for r in csv.DictReader(file) if r["source"] == "truth"]
    assert np.array(times) == pytest.approx(own.gathered.true[0].times)


def test_a_reproduction_has_each_experiment_by_both_methods(
    recording: Path, both: Report, tmp_path: Path
) -> None:
    with Recording(recording) as opened:
        at = [frame.received for frame in opened.frames]
    experiments = (
        Experiment("a", "The first", at[0] - 1.0, at[5]),
        Experiment("b", "The second", at[6], at[-1] + 1.0),
    )
    published = both.judged[1].gathered
    steps: list[tuple[int, int | None]] = []
    played = Played(recording, experiments, ())
    made = reproduction_report(played, published, lambda *step: steps.append(step))
    assert steps[-1] == (5, 5)
    assert [(each.experiment, each.method) for each in made.judged] == [
        (experiment, method)
        for experiment in ("The first", "The second")
        for method in ("rigid, as in the run", "affine, as published")
    ]
    times = [each.gathered.true[0].times.tolist() for each in made.judged]
    assert times[0] + times[2] == published.true[0].times.tolist()
    assert times[:3:2] == times[1::2]
    assert [each.number for each in made.figures] == ["9", "11", "13", "15", "16", "17", "17"]
    assert {each.missing for each in made.figures} == {""}
    written = {path.name for path in write_figures(replace(made, figures=()), tmp_path)}
    assert "speeds_the_second_rigid_as_in_the_run.csv" in written
    with (tmp_path / "experiments_errors.csv").open() as file:
        assert len({(row["experiment"], row["method"]) for row in csv.DictReader(file)}) == 4
