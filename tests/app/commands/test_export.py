"""``export`` as a shell sees it; what it writes is tested in tests/observer/exporting."""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.opening import open_source
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

from .shell import Done


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with two runs of a frame each, and one that was not recorded."""
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


def test_a_run_is_found_by_the_beginning_of_its_id(
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


def test_a_bag_is_a_folder_and_is_replaced_when_asked(
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
        ("2027", "f.csv", "2027 was not recorded"),
        ("2028", "f.csv", "there is no run 2028"),
        ("2026-a1", "f.txt", ".csv, .parquet, .mp4, .ply, .zip, or --ros2"),
        ("2026-a1", "none/f.csv", "in a folder that exists"),
        ("nowhere/recording.mcap", "f.csv", "there is no recording nowhere"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(
    shell: Callable[..., Done], data: Path, tmp_path: Path, run: str, name: str, sentence: str
) -> None:
    done = shell("export", run, "--output", str(tmp_path / name), "--data", str(data))
    assert (done.code, done.out) == (2, "")
    assert sentence in done.err
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_observe_keeps_a_recording_and_a_video(shell: Callable[..., Done], tmp_path: Path) -> None:
    recording, video, lines = (tmp_path / name for name in ("r.mcap", "v.mp4", "o.jsonl"))
    done = shell(
        "observe", "simulated:drive", "--frames", "3", "--output", str(lines),
        "--record", str(recording), "--record-images", "lossless", "--video", str(video),
        "--set", "tracking.gate=4",
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "3 pictures" in done.err
    with Recording(recording) as kept:
        assert not kept.unfinished
        assert len(lines.read_text().splitlines()) == len(list(kept.lines())) == 3
        assert kept.parameter_revisions()[0].values["tracking.gate"] == 4
        assert kept.truth() is not None
        first = kept.pair(0)
    again = shell("observe", str(recording), "--output", str(tmp_path / "p.jsonl"))
    assert again.code == 0
    source = open_source("simulated:drive").source
    frame = source.read()
    source.close()
    assert isinstance(frame, StereoFrame)
    assert (frame.left == first[0]).all()
    assert (frame.right == first[1]).all()
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "o.jsonl", "p.jsonl", "r.mcap", "v.mp4",
    ]  # fmt: skip


def test_what_was_recorded_before_stays_when_a_source_gives_nothing(
    shell: Callable[..., Done], tmp_path: Path
) -> None:
    kept = tmp_path / "r.mcap"
    kept.write_bytes(b"before")
    done = shell("observe", str(tmp_path / "none"), "--record", str(kept))
    assert done.code == 2
    assert kept.read_bytes() == b"before"
