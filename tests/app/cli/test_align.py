"""``truth``, ``align`` and ``chart`` as a shell sees them."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.reports.comparison import Comparison, TruthFile, gather_compared
from app.reports.run_chart import chart_values
from observer.truth.alignment.result import Alignment

from ..planted_runs import OFFSET_S, plant_run, speed, truth_csv
from .shell import Done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a run that recorded live motion capture, and the same data as a file."""
    folder = tmp_path_factory.mktemp("align")
    plant_run(folder / "runs" / "2026-a", "2026-a", heard=True)
    truth_csv(folder / "ride.csv")
    return folder


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def test_a_truth_file_is_described(shell: Callable[..., Done], folder: Path) -> None:
    done = shell("truth", str(folder / "ride.csv"))
    assert done.code == 0
    assert done.out.splitlines()[:2] == [
        "plain CSV, 26.8 s", "  cart: 2680 samples, 0 missing, up to 0.35 m/s",
    ]  # fmt: skip
    assert shell("truth", str(folder / "none.csv")).code == 2


def test_a_truth_file_is_aligned_with_a_run_and_charted(
    shell: Callable[..., Done], folder: Path
) -> None:
    output, speeds = folder / "compared.json", folder / "speeds.json"
    data = ["--data", str(folder)]
    done = shell(
        "align", "2026", "--truth", str(folder / "ride.csv"), "--output", str(output),
        "--speeds", str(speeds), "--match", "0:2=", *data,
    )  # fmt: skip
    assert done.code == 0, done.err
    assert done.err.startswith("Ground truth: ride.csv, aligned with the run: time offset +1")
    found = Comparison.read(output)
    assert found.alignment is not None
    assert found.alignment.time.offset_s == pytest.approx(OFFSET_S, abs=0.01)
    rows = read(speeds)
    assert len(rows) == 390
    times = np.array([row["time"] for row in rows])
    told = np.array([row["speed"] for row in rows])
    # Over the whole observation, including the time in which nothing was seen.
    assert np.sqrt(np.mean((told - speed(times)) ** 2)) < 0.02
    chart = folder / "chart.csv"
    done = shell("chart", "2026-a", "--compared", str(output), "--output", str(chart), *data)
    assert done.code == 0, done.err
    table = list(csv.DictReader(chart.read_text().splitlines()))
    bodies = {row["track_id"]: row["body"] for row in table if row["source"] == "estimate"}
    # ``--match 0:2=`` says that track 2 is none of the bodies.
    assert bodies == {"1": "cart", "2": ""}
    figure = folder / "chart.pdf"
    options = ["--compared", str(output), "--begin", "3", "--end", "9"]
    assert shell("chart", "2026-a", "--output", str(figure), *options, *data).code == 0
    assert figure.read_bytes().startswith(b"%PDF")
    for wrong in (
        ["--match", "0:1"], ["--match", "x=cart"], ["--observer", "nobody"], ["--expect=9"],
    ):  # fmt: skip
        done = shell(
            "align", "2026-a", "--truth", str(folder / "ride.csv"), "--output", str(output),
            *wrong, *data,
        )  # fmt: skip
        assert done.code in (1, 2)
        assert len(done.err.strip().splitlines()) == 1
    assert shell("chart", "2026-a", "--output", str(folder / "x.gif"), *data).code == 2


@pytest.mark.parametrize(
    ("command", "option"),
    [("chart", "--begin=nan"), ("chart", "--end=inf"), ("align", "--expect=nan"),
     ("align", "--expect=-inf")],
)  # fmt: skip
def test_times_must_be_finite(
    shell: Callable[..., Done], folder: Path, tmp_path: Path, command: str, option: str
) -> None:
    done = shell(
        command, "2026-a", "--output", str(tmp_path / "x.png"), option, "--data", str(folder)
    )
    assert done.code == 2
    assert option.partition("=")[0] in done.err
    assert "must be a finite number" in done.err
    assert len(done.err.splitlines()) == 1


def test_live_motion_capture_is_aligned_with_its_own_and_another_run(
    shell: Callable[..., Done], folder: Path
) -> None:
    output = folder / "live.json"
    done = shell("align", "2026-a", "--output", str(output), "--data", str(folder))
    assert done.code == 0, done.err
    assert "received live" in done.err
    live = read(output)
    assert live["truth"] is None
    again = plant_run(folder / "again")
    refused = shell("align", str(again), "--output", str(output))
    assert refused.code == 2
    assert "no motion capture was recorded" in refused.err
    first = str(folder / "runs" / "2026-a" / "recording.mcap")
    done = shell("align", str(again), "--truth", first, "--output", str(output))
    assert done.code == 0, done.err
    assert read(output)["facts"]["offset_s"] == pytest.approx(live["facts"]["offset_s"], abs=1e-3)


def test_speeds_are_compared_without_directions_when_the_room_pose_is_unknown(folder: Path) -> None:
    path = folder / "runs" / "2026-a" / "recording.mcap"
    truth = TruthFile(folder / "ride.csv", "ride.csv")
    from observer.recording.reader import Recording
    from observer.truth.alignment.alignment import align
    from observer.truth.alignment.observed import ObservedRun

    with Recording(path) as recording:
        found = align(ObservedRun.of_lines(recording.lines()), truth.capture())
    placeless = Alignment.of_dict({**found.as_dict(), "T_world_room": {}})
    values = chart_values(gather_compared(path, Comparison(placeless, truth)))
    placed = chart_values(gather_compared(path, Comparison(found, truth)))
    errors = {(each.group, each.label): each for each in values.errors}
    assert ("direction", "right") not in errors
    assert ("way", "backward") not in errors
    whole = next(each for each in placed.errors if each.group == "all")
    assert errors["all", "whole run"].samples == whole.samples
    assert errors["all", "whole run"].rmse_mps == pytest.approx(whole.rmse_mps, abs=1e-3)
