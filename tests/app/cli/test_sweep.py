"""``sweep`` as a shell sees it: two processes work, Ctrl-C ends them, and it is resumed."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.geometry import Pose
from observer.truth.csv_file import write_truth_csv
from observer.truth.sampled import TruthSample

from .shell import Shell

PATIENCE_S = 60.0
FRAMES = 15


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Cameras that stand before a wall of noise in which nothing moves: quick to make."""
    home = tmp_path_factory.mktemp("sweep") / "wall"
    rng = np.random.default_rng(1)
    wall = cv2.GaussianBlur(rng.integers(0, 256, (240, 360), dtype=np.uint8), (5, 5), 1.0)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    for side, shift in (("left", 0), ("right", 12)):
        (home / side).mkdir(parents=True)
        for i in range(FRAMES):
            cv2.imwrite(str(home / side / f"{i:02}.png"), wall[:, shift : shift + 320])
    (home / "times.txt").write_text("".join(f"{i / 15}\n" for i in range(FRAMES)))
    K, none, apart = np.diag([300.0, 300.0, 1.0]), np.zeros(4), np.array([-0.1, 0.0, 0.0])
    K[:2, 2] = 160, 120
    calibration = StereoCalibration(320, 240, K, none, K, none, np.eye(3), apart)
    (home / "calibration.yaml").write_text(calibration_text(calibration))
    write_truth_csv(
        home / "truth.csv", [TruthSample(i, i / 15, (), Pose.identity()) for i in range(FRAMES)]
    )
    return home


@pytest.mark.patient
def test_an_interrupted_sweep_keeps_finished_results(
    folder: Path, tmp_path: Path, shell: Shell
) -> None:
    grid, output = tmp_path / "grid.yaml", tmp_path / "out"
    # More than can finish before Ctrl-C is pressed.
    spacings = list(range(6, 65))
    grid.write_text(f"klt_tracking.spacing_px: {spacings}\nevidence.memory_s: [0.3, 0.5, 0.7]\n")
    arguments = ["sweep", str(grid), str(folder), "--output", str(output)]
    process = subprocess.Popen(
        [sys.executable, "-m", "app.cli", *arguments, "--jobs", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Ctrl-C reaches every process of a terminal, the workers too.
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + PATIENCE_S
        while not list(output.glob("tasks/*.json")):
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert (process.returncode, out) == (130, "")
    first, last = err.splitlines()
    assert first == "177 combinations over 1 sources: 177 tasks, 0 of them already finished"
    finished = len(list(output.glob("tasks/*.json")))
    assert 1 <= finished < 177
    assert last.startswith(f"interrupted with {177 - finished} of 177 tasks left")
    assert "The sweep was interrupted with" in (output / "ranking.md").read_text()
    assert {path.name for path in output.iterdir()} == {
        "tasks", "ranking.md", "ranking.csv", "results.parquet", "sweep.png",
    }  # fmt: skip

    # Finished tasks need no process; a busy machine may have started with any of them.
    kept = json.loads(next(output.glob("tasks/*.json")).read_text())["parameters"]
    spacing, memory = kept["klt_tracking.spacing_px"], kept["evidence.memory_s"]
    grid.write_text(f"klt_tracking.spacing_px: [{spacing}]\nevidence.memory_s: [{memory}]\n")
    again = shell(*arguments, "--rank-by", "recall")
    assert again.code == 0, again.err
    assert again.err == "1 combinations over 1 sources: 1 tasks, 1 of them already finished\n"
    (row,) = csv.DictReader((output / "ranking.csv").read_text().splitlines())
    told = (row["klt_tracking.spacing_px"], row["evidence.memory_s"])
    assert tuple(map(float, told)) == (spacing, memory)
    assert "ranked by recall" in again.out


@pytest.mark.parametrize(
    ("text", "arguments", "part"),
    [
        ("evidence.radius_px: [900]", (), "from 4 to 200 px"),
        ("evidence.radius_px: [20]", ("--limit", "1", "--random", "1"), "not both"),
        ("evidence.radius_px: [20]", ("--jobs", "1", "--scheduler", "tcp://h:1"), "--jobs"),
        ("evidence.radius_px: [20]", ("--rank-by", "beauty"), "beauty"),
        ("evidence.radius_px: [20]", ("--output", "/dev/null/x"), "/dev/null/x"),
        ("evidence.radius_px: [20]", ("--rank-by", "time_ratio"), "time_ratio is not measured"),
        ("evidence.radius_px: [20]", ("--runs", "3"), "--runs 3 has no effect on these sources"),
        ("navigation.berth_m: [0.2]", ("crowd:hard:0.1",), "sweep over only one"),
    ],
)
def test_invalid_arguments_are_reported_before_the_work(
    tmp_path: Path, folder: Path, shell: Shell, text: str, arguments: tuple[str, ...], part: str
) -> None:
    grid = tmp_path / "grid.yaml"
    grid.write_text(text)
    output = () if "--output" in arguments else ("--output", str(tmp_path / "out"))
    done = shell("sweep", str(grid), str(folder), *output, *arguments)
    assert (done.code, done.out) == (2, "")
    assert len(done.err.strip().splitlines()) == 1, done.err
    assert part in done.err
