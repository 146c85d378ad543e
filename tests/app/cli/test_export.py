"""``export`` as a shell sees it; what it writes is tested in tests/observer/exporting."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import pytest

from app.cli.command_line import load_command
from app.cli.keeping import keeping
from observer.calibration.formats.opencv_file import calibration_text
from observer.exporting.choices import TableName
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame
from tools import ROOT

from .shell import Done


def test_the_command_and_the_page_name_every_table() -> None:
    (option,) = (each for each in load_command("export").params if each.name == "table")
    told = set(re.findall(r"\w+", getattr(option, "help", "")))
    assert told >= set(get_args(TableName))
    page = (ROOT / "static/app/runs/run-export.js").read_text(encoding="utf-8")
    listed = page.partition("const TABLES = [")[2].partition("];")[0]
    assert re.findall(r'\["(\w+)"', listed) == list(get_args(TableName))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with two runs of one frame each, and one that was not recorded."""
    folder = tmp_path_factory.mktemp("data")
    source = open_source("simulated:drive").source
    assert source.calibration is not None
    frame = source.read()
    assert isinstance(frame, StereoFrame)
    for run in ("2026-a1", "2026-b2"):
        (folder / "runs" / run).mkdir(parents=True)
        facts = RunFacts(
            id=run,
            name="",
            source="simulated:drive",
            info=asdict(source.info),
            calibration_yaml=calibration_text(source.calibration),
        )
        writer = RecordingWriter(folder / "runs" / run / "recording.mcap", facts)
        writer.frame(frame)
        writer.finish()
    (folder / "runs" / "2027").mkdir()
    source.close()
    return folder


def test_a_run_is_found_by_its_id_prefix(
    shell: Callable[..., Done], data: Path, tmp_path: Path
) -> None:
    output = tmp_path / "odometry.csv"
    options = ["--output", str(output), "--table", "odometry", "--data", str(data)]
    done = shell("export", "2026-b", *options)
    assert (done.code, done.out) == (0, "")
    assert "1 rows" in done.err
    assert [row["frame"] for row in csv.DictReader(io.StringIO(output.read_text()))] == ["0"]
    again = shell("export", "2026-b", *options)
    assert again.code == 2
    assert "--overwrite" in again.err
    assert shell("export", "2026-b", *options, "--overwrite").code == 0


def test_a_bag_is_a_folder_and_is_replaced_on_overwrite(
    shell: Callable[..., Done], data: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags, of the extra ros")
    output = tmp_path / "bag"
    run = str(data / "runs" / "2026-a1")
    assert shell("export", run, "--ros2", "--output", str(output)).code == 0
    assert shell("export", run, "--ros2", "--output", str(output)).code == 2
    assert shell("export", run, "--ros2", "--output", str(output), "--overwrite").code == 0
    assert sorted(each.name for each in output.iterdir()) == ["bag.db3", "metadata.yaml"]
    with sqlite3.connect(output / "bag.db3") as database:
        topics = {name for (name,) in database.execute("SELECT name FROM topics")}
    database.close()
    assert "/camera/left/image_raw/compressed" in topics


@pytest.mark.parametrize(
    ("run", "name", "sentence"),
    [
        ("2026", "f.csv", "several runs (2026-a1, 2026-b2)"),
        ("2027", "f.csv", "the run 2027 has no recording"),
        ("2028", "f.csv", "there is no run 2028"),
        ("2026-a1", "f.txt", ".csv, .parquet, .tum, .mp4, .ply, .zip, or --ros2"),
        ("2026-a1", "none/f.csv", "in an existing, writable folder"),
        ("nowhere/recording.mcap", "f.csv", "there is no recording nowhere"),
    ],
)
def test_an_impossible_export_gives_a_one_line_error(
    shell: Callable[..., Done], data: Path, tmp_path: Path, run: str, name: str, sentence: str
) -> None:
    done = shell("export", run, "--output", str(tmp_path / name), "--data", str(data))
    assert (done.code, done.out) == (2, "")
    assert sentence in done.err
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_observe_writes_a_recording_and_a_video(shell: Callable[..., Done], tmp_path: Path) -> None:
    recording, video, lines = (tmp_path / name for name in ("r.mcap", "v.mp4", "o.jsonl"))
    done = shell(
        "observe", "simulated:drive", "--frames", "3", "--output", str(lines),
        "--record", str(recording), "--record-images", "lossless", "--video", str(video),
        "--set", "klt_tracking.spacing_px=20",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "3 frames" in done.err
    with Recording(recording) as kept:
        assert not kept.unfinished
        assert len(lines.read_text().splitlines()) == len(list(kept.lines())) == 3
        assert kept.parameter_revisions()[0].values["klt_tracking.spacing_px"] == 20
        assert kept.truth() is not None
    played = tmp_path / "p.jsonl"
    again = shell(
        "observe", str(recording), "--output", str(played), "--set", "klt_tracking.spacing_px=20"
    )
    assert again.code == 0
    # Lossless: the recording as a source gives identical results to the last digit.
    both = [
        [{**json.loads(text), "timings_ms": {}} for text in path.read_text().splitlines()]
        for path in (lines, played)
    ]
    assert both[0] == both[1]
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "o.jsonl", "p.jsonl", "r.mcap", "v.mp4",
    ]  # fmt: skip


def test_an_existing_recording_is_unchanged_when_the_source_has_no_frames(
    shell: Callable[..., Done], tmp_path: Path
) -> None:
    kept = tmp_path / "r.mcap"
    kept.write_bytes(b"before")
    done = shell("observe", str(tmp_path / "none"), "--record", str(kept))
    assert done.code == 2
    assert kept.read_bytes() == b"before"


def test_an_interrupt_finishes_recording_and_video_cleanly(data: Path, tmp_path: Path) -> None:
    source = RecordingSource(data / "runs" / "2026-a1" / "recording.mcap")
    calibration = source.calibration
    frame = source.read()
    assert calibration is not None
    assert isinstance(frame, StereoFrame)
    parameters = Parameters()
    record, video = tmp_path / "r.mcap", tmp_path / "v.mp4"
    for path in (record, video):
        path.with_name(f"{path.name}.part").write_bytes(b"left by an earlier failure")

    def observe_until_interrupted() -> None:
        with keeping(
            source.info, None, calibration, parameters, "default",
            record=record, images="jpeg", video=video,
        ) as kept:  # fmt: skip
            kept.frame(frame)
            observation = Observer(calibration, parameters).observe(frame)
            kept.observed(frame, observation, observation_line(observation))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        observe_until_interrupted()
    source.close()
    with Recording(record) as recording:
        assert not recording.unfinished
        assert len(list(recording.lines())) == 1
    assert b"ftyp" in video.read_bytes()[:16]
    assert sorted(each.name for each in tmp_path.iterdir()) == ["r.mcap", "v.mp4"]
