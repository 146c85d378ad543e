"""Ground truth of a run whose engine was replaced: each part is compared with its own.

The source starts again there, so its times repeat. In these runs the bodies drive before the
restart and stand after it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import observer
from app.reports.comparison import true_speeds
from app.reports.experiments import observed_as_published
from app.reports.gathering import gather
from app.workers.methods.frames import run_frames
from observer.errors import SourceError
from observer.evaluation.source_run import run_source
from observer.evaluation.sources import described
from observer.exporting import run_video
from observer.exporting.clouds import _pose_at as cloud_pose
from observer.exporting.ros2 import ExposureClock
from observer.jsonl import line_pose, observation_line
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.parameters import preset
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.sources.contract import begins_segment
from observer.truth.contract import TrueBody
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame
from observer.vision.rectification import Rectification

from ...observer.recording.conftest import facts_of
from ...observer.recording.conftest import frames as frames
from ...observer.recording.conftest import lab as lab

FIRST, SECOND = 20, 14


def at_rest(bodies: Iterable[TrueBody]) -> tuple[TrueBody, ...]:
    return tuple(replace(body, velocity=np.zeros(3)) for body in bodies)


@pytest.fixture
def restarted(tmp_path: Path, lab: OpenedSource, frames: tuple[StereoFrame, ...]) -> Path:
    """A run whose engine was replaced after ``FIRST`` frames."""
    path = tmp_path / "recording.mcap"
    assert lab.source.calibration is not None
    assert lab.truth is not None
    writer = RecordingWriter(path, facts_of(lab.source))
    for segment, count in enumerate((FIRST, SECOND)):
        if segment:
            writer.finish()
            writer = RecordingWriter.resume(path)
        observing = Observer(lab.source.calibration, mount=lab.source.info.mount)
        for frame in frames[:count]:
            received = frame.received + 10.0 * segment
            writer.frame(replace(frame, received=received))
            line: dict[str, Any] = {**observation_line(observing.observe(frame))}
            line["segment"] = segment
            bodies, pose = lab.truth.bodies(frame.time), lab.truth.camera_pose(frame.time)
            if segment:
                bodies = at_rest(bodies)
            writer.truth(TruthSample(frame.index, frame.time, bodies, pose), received)
            writer.observation(line, received)
    writer.finish()
    return path


def fastest(speeds: Iterable[float]) -> float:
    return max(speeds, default=float("nan"))


def parts(values: list[Any]) -> tuple[list[Any], list[Any]]:
    assert len(values) == FIRST + SECOND
    return values[:FIRST], values[FIRST:]


def test_the_frames_of_a_run(restarted: Path) -> None:
    with Recording(restarted) as recording:
        found = run_frames(recording, recording.truth())
    driven, stood = parts([fastest(body.speed for body in each.truth) for each in found.frames])
    assert min(driven) > 0.1
    assert stood == [0.0] * SECOND
    plans = [fastest(math.hypot(*b.velocity) for b in f.plan.truth) for f in found.frames]
    assert fastest(parts(plans)[1]) == 0.0
    # Nobody moves after the restart, so nobody is missed.
    counts = [each.counts for each in found.frames if each.counts is not None]
    due = [each.found + each.missed for each in counts]
    assert len(set(parts(due)[1])) == 1


def test_the_report_of_a_run_and_its_table(restarted: Path) -> None:
    with Recording(restarted) as recording:
        gathered, rows = gather(recording), true_speeds(recording)
    assert gathered.true
    for motion in gathered.true:
        assert len(motion.times) == FIRST + SECOND
        assert (np.diff(motion.times) > 0).all()
        assert motion.speeds[:FIRST].min() > 0.1
        assert motion.speeds[FIRST:].tolist() == [0.0] * SECOND
    assert {row["speed"] for row in rows if row["segment"] == 1} == {0.0}


def test_the_published_method_in_the_report(restarted: Path) -> None:
    gathered = observed_as_published(restarted, lambda _done, _of: None)
    assert [line["segment"] for line in gathered.lines] == [0] * FIRST + [1] * SECOND
    assert {body.speed for each in gathered.matched[FIRST:] for body in each.bodies} == {0.0}


def test_the_run_in_a_notebook(restarted: Path) -> None:
    with observer.load(restarted) as run:
        truth = run.truth
        assert truth is not None
        speeds = [fastest(b.speed for b in truth.bodies(time)) for time in run.run_times]
        again = run.rerun()
    driven, stood = parts(speeds)
    assert min(driven) > 0.1
    assert stood == [0.0] * SECOND
    assert [line["segment"] for line in again] == [0] * FIRST + [1] * SECOND


def test_the_recording_as_a_source(restarted: Path) -> None:
    opened = open_source(str(restarted))
    assert opened.truth is not None
    times, speeds, began = [], [], []
    with closing(opened.source):
        while (frame := opened.source.read()) is not None:
            assert isinstance(frame, StereoFrame)
            began.append(begins_segment(opened.source))
            times.append(frame.time)
            speeds.append(fastest(body.speed for body in opened.truth.bodies(frame.time)))
    assert (np.diff(times) > 0).all()
    assert [k for k, each in enumerate(began) if each] == [0, FIRST]
    driven, stood = parts(speeds)
    assert min(driven) > 0.1
    assert stood == [0.0] * SECOND


def test_the_recording_observed_in_a_notebook(restarted: Path) -> None:
    with observer.open(str(restarted)) as observed:
        steps = [(step.line["segment"], fastest(b.speed for b in step.truth)) for step in observed]
    driven, stood = parts(steps)
    assert {segment for segment, _ in driven} == {0}
    assert set(stood) == {(1, 0.0)}


def test_the_recording_in_a_benchmark(restarted: Path) -> None:
    source = described(str(restarted))
    found = run_source(source, {"default": preset("default")}, 100, 0.5, lambda _: None)
    tally = found["default"].tally
    assert tally is not None
    assert {sample.segment for sample in tally.samples} == {0}


def test_a_new_observer_begins_although_its_first_frame_is_lost(
    restarted: Path,
    lab: OpenedSource,
    frames: tuple[StereoFrame, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = Recording.pair

    def damaged(self: Recording, position: int) -> Any:
        if position == FIRST:
            raise SourceError("its images are lost")
        return pair(self, position)

    monkeypatch.setattr(Recording, "pair", damaged)
    with observer.load(restarted) as run:
        again = run.rerun()
    assert lab.source.calibration is not None
    new = Observer(lab.source.calibration, mount=lab.source.info.mount)
    expected = [observation_line(new.observe(frame)) for frame in frames[1:SECOND]]
    assert [_bare(line) for line in again[FIRST:]] == [_bare(line) for line in expected]
    assert {line["segment"] for line in again[FIRST:]} == {1}


def test_exports_take_each_observation_for_that_of_its_own_frame(
    restarted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[int, float]] = []
    video = SimpleNamespace(finish=lambda: None, abort=lambda: None)
    video.add = lambda picture, time: seen.append((int(picture), time))
    monkeypatch.setattr(run_video, "OverlayVideo", lambda *_: video)
    monkeypatch.setattr(run_video, "draw_overlay", lambda left, _: left)
    monkeypatch.setattr(Rectification, "apply_left", lambda _, left: left)
    monkeypatch.setattr(Recording, "pair", lambda _, position: (position, position))
    with Recording(restarted) as recording:
        clock = ExposureClock(recording)
        lines = list(recording.lines())
        stamps = [clock.of_frame("/observation", line["frame"], line["time"]) for line in lines]
        assert (np.diff(stamps) > 0).all()
        pose, expected = cloud_pose(recording, FIRST + 5), line_pose(lines[FIRST + 5])
        assert expected is not None
        assert pose.translation.tolist() == expected.translation.tolist()
        run_video.write_run_video(recording, restarted.with_suffix(".mp4"))
    assert [position for position, _ in seen] == list(range(FIRST + SECOND))
    assert (np.diff([time for _, time in seen]) > 0).all()


def _bare(line: Any) -> dict[str, Any]:
    return {k: v for k, v in line.items() if k not in ("timings_ms", "segment")}
