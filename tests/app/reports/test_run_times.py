"""A run's length in report, chart and CSV: on a busy machine, and where an engine was replaced."""

from __future__ import annotations

import csv
import io
import time
from pathlib import Path
from typing import cast

import pytest

from app.reports.gathering import _true_motions, gather, seen_motions
from app.reports.moments import Moments
from app.reports.page import report_html
from app.reports.report import make_report
from app.reports.run_chart import chart_csv, chart_values
from app.reports.speed_figure import speed_figure
from observer.jsonl import ObservationLine, observation_line
from observer.observer import Observer
from observer.opening import open_source
from observer.recording.payloads import MatchedBody, MatchedTruth, RecordedFrame
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

from .conftest import record

FRAMES = 8
STEP = 1 / 15


def _go_on(path: Path) -> None:
    """Record as many frames again with another engine, for which the lab starts again."""
    opened = open_source("simulated:lab")
    source, truth = opened.source, opened.truth
    assert source.calibration is not None
    assert truth is not None
    observer = Observer(source.calibration, mount=source.info.mount)
    writer = RecordingWriter.resume(path)
    begin = time.monotonic()
    for _ in range(FRAMES):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        fields = {name: getattr(frame, name) for name in frame.__dataclass_fields__}
        frame = StereoFrame(**{**fields, "received": begin + frame.time})
        writer.frame(frame)
        line = {**observation_line(observer.observe(frame)), "segment": 1}
        writer.observation(line, frame.received)
        bodies, pose = truth.bodies(frame.time), truth.camera_pose(frame.time)
        writer.truth(TruthSample(frame.index, frame.time, bodies, pose), frame.received)
    writer.finish()
    source.close()


@pytest.mark.parametrize(
    ("slower", "engines", "length"),
    [(11.0, 1, (FRAMES - 1) * STEP), (1.0, 2, (2 * FRAMES - 1) * STEP)],
)
def test_report_chart_and_csv_agree_on_the_length(
    tmp_path: Path, slower: float, engines: int, length: float
) -> None:
    path = record(tmp_path / "r.mcap", images="none", frames=FRAMES, slower=slower)
    if engines == 2:
        _go_on(path)
    report = make_report(path, lambda _done, _of: None)
    assert report.duration_s == pytest.approx(length)
    assert f"<dd>{length:.1f} s, {engines * FRAMES} frames</dd>" in report_html(report)
    with Recording(path) as recording:
        gathered = gather(recording)
    rows = list(csv.DictReader(io.StringIO(chart_csv(chart_values(gathered)))))
    times = [float(row["time_s"]) for row in rows if row["source"] == "truth"]
    # The lab's truth is known at every frame.
    assert len(times) == engines * FRAMES
    assert times == sorted(times)
    assert (times[0], times[-1]) == pytest.approx((0.0, length), abs=1e-4)
    assert speed_figure([("run", gathered)]).axes[0].get_xlim() == pytest.approx((0.0, length))


def test_truth_is_matched_to_the_frame_of_its_own_engine() -> None:
    frames, lines, matched = [], [], []
    # Numbers and times of frames and ids of tracks begin again; the second camera looks back.
    for segment, (name, turn) in enumerate([("cart", [1, 0, 0, 0]), ("trolley", [0, 0, 1, 0])]):
        for k in range(3):
            frames.append(RecordedFrame(index=k, time=k * STEP, received=10 * segment + k * STEP))
            entry = {
                "id": 7, "state": "confirmed", "speed": 0.5, "speed_std": None,
                "velocity_time": k * STEP,
            }  # fmt: skip
            pose = {"position": [0, 0, 0], "orientation_wxyz": turn}
            lines.append(
                {"frame": k, "time": k * STEP, "segment": segment, "pose": pose,
                 "obstacles": [entry]}
            )  # fmt: skip
            body = MatchedBody(
                id=1, name=name, role="obstacle", position=[0, 0, 3], velocity=[0.5, 0, 0],
                speed=0.5, size=[0.4, 0.4, 0.3], yaw=0.0, track_id=7,
            )  # fmt: skip
            matched.append(MatchedTruth(frame=k, time=k * STEP, bodies=[body]))
    times = RunTimes(frames)
    placed = times.lines(cast(list[ObservationLine], lines))
    true = times.matched(matched)
    seen, unmatched = seen_motions(placed, true)
    assert [(each.track, each.body, len(each.times)) for each in seen] == [
        ("0:7", "cart", 3),
        ("1:7", "trolley", 3),
    ]
    assert not unmatched
    directions = {each.body: each.directions for each in _true_motions(placed, true)}
    assert directions == {
        "cart": ("right",) * 3 + ("",) * 3,
        "trolley": ("",) * 3 + ("left",) * 3,
    }


def test_pictures_show_the_frame_of_their_own_engine(tmp_path: Path) -> None:
    path = record(tmp_path / "r.mcap", frames=FRAMES)
    _go_on(path)
    with Recording(path) as recording:
        gathered = gather(recording)
    source = RecordingSource(path)
    moments = Moments(source, gathered)
    for position in (FRAMES - 1, 2 * FRAMES - 1):
        moment = moments.published(position)
        assert moment is not None
        assert moment.line is gathered.lines[position]
        assert moment.by_truth
    source.close()
