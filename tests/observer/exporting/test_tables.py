"""Tables hold every number of the recording, with units in the column names."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import sys
from contextlib import closing
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from observer.exporting.choices import TableName
from observer.exporting.errors import ExportError
from observer.exporting.table_files import write_csv, write_parquet
from observer.exporting.tables import TABLES, find_table
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

from .conftest import CELLS, GOAL

_UNITS = re.compile(r"_(m|mps|s|rad|radps|px|m2|m2ps2)$")
_WITHOUT = {
    "frame", "segment", "status", "id", "state", "motion", "points", "significance", "why",
    "reasons", "parameters_revision", "obstacles", "name", "role", "visible", "track_id", "reason",
    "waits_for", "refused", "size", "runs",
    "source_position", "revision", "from_position", "value", "qw", "qx", "qy", "qz",
}  # fmt: skip


def read_csv(name: str, recording: Recording) -> list[dict[str, str]]:
    file = io.StringIO()
    count = write_csv(TABLES[name], recording, file)
    rows = list(csv.DictReader(io.StringIO(file.getvalue())))
    assert len(rows) == count
    return rows


def samples_of(recording: Recording) -> list[TruthSample]:
    """Return the ground truth at each frame, in order."""
    return [s for _, truth in recording.truths() if truth is not None for s in truth.samples]


def test_every_table_can_be_chosen() -> None:
    assert get_args(TableName) == tuple(TABLES)


def test_every_number_has_its_unit() -> None:
    for table in TABLES.values():
        for column in table.columns:
            bare = column.name.removeprefix("camera_")
            assert _UNITS.search(column.name) or bare in _WITHOUT, column.name


def test_each_obstacle_has_a_row_per_frame_with_full_precision(recorded: dict[str, Path]) -> None:
    with Recording(recorded["none"]) as recording:
        entries = [(line, each) for line in recording.lines() for each in line["obstacles"]]
        rows = read_csv("obstacles", recording)
        assert entries
        assert len(rows) == len(entries)
        for (line, entry), row in zip(entries, rows, strict=True):
            assert (int(row["frame"]), int(row["id"])) == (line["frame"], entry["id"])
            assert [float(row[c]) for c in ("x_m", "y_m", "z_m")] == entry["position"]
            assert [float(row[c]) for c in ("vx_mps", "vy_mps", "vz_mps")] == entry["velocity"]
            assert float(row["speed_mps"]) == entry["speed"]
            assert float(row["cov_yz_m2"]) == entry["position_cov"][1][2]
            assert float(row["cov_vzvz_m2ps2"]) == entry["velocity_cov"][2][2]
            assert row["why"] == entry["why"]


def test_truth_after_a_restart_of_the_source_has_rows_too(
    recorded: dict[str, Path], tmp_path: Path
) -> None:
    path = tmp_path / "restarted.mcap"
    shutil.copy(recorded["none"], path)
    with Recording(path) as recording:
        before = samples_of(recording)
    writer = RecordingWriter.resume(path)
    with closing(RecordingSource(recorded["lossless"])) as source:
        for sample in before[:3]:
            frame = source.read()
            assert isinstance(frame, StereoFrame)
            writer.frame(frame)
            writer.truth(sample, frame.received)
    writer.finish()
    with Recording(path) as recording:
        rows = read_csv("truth", recording)
    expected = [(s.frame, body.name) for s in (*before, *before[:3]) for body in s.bodies]
    assert [(int(r["frame"]), r["name"]) for r in rows] == expected


def test_truth_odometry_robots_frames_and_parameters_have_tables(
    recorded: dict[str, Path],
) -> None:
    with Recording(recorded["none"]) as recording:
        true = [(s.frame, body) for s in samples_of(recording) for body in s.bodies]
        rows = read_csv("truth", recording)
        assert [(int(r["frame"]), r["name"]) for r in rows] == [(f, b.name) for f, b in true]
        assert [float(r["x_m"]) for r in rows] == [b.position[0] for _, b in true]
        matched = read_csv("matched_truth", recording)
        assert {r["track_id"] for r in matched if r["role"] == "obstacle"} == {"1"}
        assert {r["track_id"] for r in matched if r["role"] == "observer"} == {""}
        told = [frame.odometry for frame in recording.frames if frame.odometry is not None]
        assert [float(r["yaw_rad"]) for r in read_csv("odometry", recording)] == [
            each.yaw for each in told
        ]
        assert {r["encoder_speed_mps"] for r in read_csv("robots", recording)} == {"0.2"}
        goals = read_csv("goal", recording)
        assert {(r["state"], r["ahead_m"], r["left_m"], r["waits_for"]) for r in goals} == {
            ("driving", "2.0", "-0.5", "3")
        }
        assert {r["reason"] for r in goals} == {GOAL["sentence"]}
        assert {(r["meets_ahead_m"], r["meets_left_m"]) for r in goals} == {("1.2", "0.1")}
        assert json.loads(goals[0]["refused"]) == GOAL["refused"]
        maps = read_csv("map", recording)
        assert [int(r["frame"]) for r in maps] == [recording.frames[k].index for k in (0, 8)]
        assert {(r["corner_x_m"], r["robot_yaw_rad"]) for r in maps} == {("-0.3", "-0.1")}
        # Decoded as the column name says.
        runs, size = json.loads(maps[0]["runs"]), int(maps[0]["size"])
        read = np.repeat(np.arange(len(runs)) % 3, runs).reshape(size, size)
        np.testing.assert_array_equal(read, CELLS)
        frames = read_csv("frames", recording)
        assert len(frames) == len(recording.frames)
        within = [(each["source_position"], each["source_time_s"]) for each in frames]
        assert within[:2] == [("", ""), ("", "")]
        assert [(int(k), float(t)) for k, t in within[2:]] == [
            (k % 5, 0.1 * (k % 5)) for k in range(2, len(frames))
        ]
        values = {r["name"]: r["value"] for r in read_csv("parameters", recording)}
        assert values["ego_motion.model"] == '"rigid"'


def test_parquet_holds_the_same_rows_with_types_and_help(recorded: dict[str, Path]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow, of the extra parquet")
    with Recording(recorded["none"]) as recording:
        for name in ("obstacles", "truth", "goal", "map", "parameters"):
            packed = io.BytesIO()
            write_parquet(TABLES[name], recording, packed)
            packed.seek(0)
            table = parquet.read_table(packed)
            assert table.to_pylist() == list(TABLES[name].rows(recording))
    field = table.schema.field("value")
    assert field.metadata[b"help"] == b"as JSON"


def test_without_the_package_the_extra_is_named(
    recorded: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with Recording(recorded["none"]) as recording, pytest.raises(ExportError) as refused:
        write_parquet(TABLES["truth"], recording, io.BytesIO())
    assert "dynamic-observer[parquet]" in str(refused.value)


def test_an_unknown_table_is_refused_with_the_available_ones() -> None:
    with pytest.raises(ExportError, match="obstacles, frames, truth"):
        find_table("obstacle")
