"""Parts of a run by themselves, and the same frames with the method as published."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.reports import experiments, reproduction
from app.reports import report as report_module
from app.reports.experiments import (
    Experiment,
    beside_published,
    judged,
)
from app.reports.page import report_html
from app.reports.report import Report, write_figures
from app.reports.reproduction import Played
from app.reports.stretches import during
from observer.motion_profiles.profile import MotionProfile
from observer.recording.reader import Recording

from ..cli.shell import Shell


@pytest.fixture(scope="session")
def both(recording: Path, report: Report) -> Report:
    """The run's report together with the method as published."""
    return beside_published(report, recording, lambda _done, _of: None)


@pytest.fixture(scope="session")
def experiment(recording: Path) -> Experiment:
    """The last eight frames of the run."""
    with Recording(recording) as opened:
        frames = opened.frames
    return Experiment("Late in the run", frames[4].received, frames[-1].received + 1.0)


def test_only_data_within_the_experiment_are_judged(
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


def test_the_published_method_processes_the_same_frames(
    report: Report, both: Report, tmp_path: Path
) -> None:
    own, published = both.judged
    assert len(published.gathered.lines) == len(report.gathered.lines)
    assert published.gathered.true[0].speeds == pytest.approx(report.gathered.true[0].speeds)
    # The lines come from the other method, not from the recording.
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


def test_a_reproduction_shows_each_experiment_with_both_methods(
    recording: Path,
    both: Report,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Recording(recording) as opened:
        at = [frame.received for frame in opened.frames]
    driven = (
        Experiment("The first", at[0] - 1.0, at[5]),
        Experiment("The second", at[6], at[-1] + 1.0),
    )
    published = both.judged[1].gathered
    asked: list[str] = []

    def played(path: Path, programmes: list[MotionProfile], **_: Any) -> Played:
        assert path == tmp_path / "recording.mcap"
        asked.extend(each.name for each in programmes)
        return Played(recording, driven, ("no camera frame for 200 ms",))

    # Already driven and observed again; one format is as good as three.
    monkeypatch.setattr(reproduction, "play_experiments", played)
    monkeypatch.setattr(experiments, "observed_as_published", lambda _path, _progress: published)
    monkeypatch.setattr(report_module, "FORMATS", ("png",))
    done = Shell(capsys)("reproduce", "--output", str(tmp_path))
    assert (done.code, done.out) == (0, ""), done.err
    assert asked == ["figure17_a", "figure17_b"]
    for title in ("The first", "The second"):
        for method in ("rigid, as in the run", "affine, as published"):
            assert f"{title}, {method}: RMSE 0.0" in done.err
    page = (tmp_path / "report.html").read_text()
    assert "By experiment and method" in page
    assert page.count("<figure id=") == 8
    not_shown = "<b>Not shown:</b> The source of this run, simulated:lab, is a simulator"
    assert page.count(not_shown) == 2
    assert page.count("<li>Figure ") == 2
    assert {path.name for path in (tmp_path / "programmes").iterdir()} == {
        "figure17_a.yaml", "figure17_b.yaml",
    }  # fmt: skip
    assert json.loads((tmp_path / "experiments.json").read_text()) == {
        "experiments": ["The first", "The second"],
        "ended_early": ["no camera frame for 200 ms"],
    }
    figures = tmp_path / "figures"
    assert {path.stem for path in figures.glob("*.png")} == {
        "figure9", "figure11", "figure12", "figure13", "figure15", "figure16", "figure17",
        "figure17_experiments",
    }  # fmt: skip
    with (figures / "experiments_errors.csv").open() as file:
        assert len({(row["experiment"], row["method"]) for row in csv.DictReader(file)}) == 4
    with (figures / "speeds_the_second_rigid_as_in_the_run.csv").open() as file:
        times = [float(r["time_s"]) for r in csv.DictReader(file) if r["source"] == "truth"]
    assert times == published.true[0].times[6:].tolist()
