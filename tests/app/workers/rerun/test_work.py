"""The worker observes a recording again: the run's own frames, and nothing else changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.workers.frame_results import read_results
from app.workers.rerun.messages import Rerun
from app.workers.rerun.work import rerun
from observer.errors import SourceError
from observer.jsonl import observation_line
from observer.navigation.parameters import AllParameters
from observer.observer import Observer
from observer.opening import OpenedSource
from observer.parameters import preset
from observer.recording.payloads import Images
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.truth.matching import TruthMatcher
from observer.types import StereoFrame

from ....observer.recording.conftest import facts_of
from ....observer.recording.conftest import frames as frames
from ....observer.recording.conftest import lab as lab

# Numbers of frames before and after the engine was replaced.
FIRST, SECOND = 10, 5


def recorded(
    path: Path,
    lab: OpenedSource,
    frames: Sequence[StereoFrame],
    images: Images = "lossless",
    *,
    driven: bool = False,
) -> list[dict[str, Any]]:
    """Record a run whose engine was replaced: its source was restarted. Return its lines.

    Args:
        driven: only before the restart were the robots driven; since then they stand.
    """
    lines: list[dict[str, Any]] = []
    assert lab.source.calibration is not None
    assert lab.truth is not None
    writer = RecordingWriter(path, facts_of(lab.source, images))
    for segment, count in enumerate((FIRST, SECOND)):
        if segment:
            writer.finish()
            writer = RecordingWriter.resume(path)
        observer = Observer(lab.source.calibration, mount=lab.source.info.mount)
        matcher = TruthMatcher(lab.truth)
        for frame in frames[:count]:
            writer.frame(frame)
            line = {**observation_line(observer.observe(frame)), "segment": segment}
            sample = matcher.sample(frame.index, frame.time, frame.time)
            if segment and driven:
                bodies = [replace(body, velocity=np.zeros(3)) for body in sample.bodies]
                sample = replace(sample, bodies=tuple(bodies))
            writer.truth(sample, frame.received)
            writer.observation(line, frame.received)
            lines.append(line)
    writer.finish()
    return lines


def job(folder: Path, **values: Any) -> Rerun:
    parameters = AllParameters().changed(values)
    return Rerun(
        images=str(folder / "recording.mcap"),
        output=str(folder / "again.mcap"),
        results=str(folder / "results.jsonl"),
        id="20270101-000000-abcdef",
        name="again",
        preset="default",
        versions={"dynamic-observer": "0.2.0"},
        parameters=dict(parameters.flat()),
        rig_yaml=None,
    )


def bare(lines: Sequence[Any]) -> list[dict[str, Any]]:
    """Return all results without what depends on the clock, and without the revision number."""
    left_out = {"timings_ms", "parameters_revision"}
    return [{key: v for key, v in line.items() if key not in left_out} for line in lines]


def test_the_same_parameters_give_the_same_run(
    tmp_path: Path, lab: OpenedSource, frames: tuple[StereoFrame, ...]
) -> None:
    lines = recorded(tmp_path / "recording.mcap", lab, frames)
    told: list[float] = []
    done = rerun(job(tmp_path), lambda _, share: told.append(share))
    assert (done.frames, done.segments, done.lost) == (FIRST + SECOND, 2, 0)
    assert told
    with (
        Recording(tmp_path / "recording.mcap") as original,
        Recording(tmp_path / "again.mcap") as again,
    ):
        assert bare(list(again.lines())) == bare(lines)
        assert any(line["obstacles"] for line in lines)
        times = [(f.index, f.time, f.received, f.begins) for f in original.frames]
        assert [(f.index, f.time, f.received, f.begins) for f in again.frames] == times
        assert not again.images_held
        assert (again.facts.id, again.facts.name) == ("20270101-000000-abcdef", "again")
        assert again.facts.camera_mount() == original.facts.camera_mount()
        assert again.truth() is not None
        assert any(each.bodies for each in again.matched_truth())
        assert done.bytes == (tmp_path / "again.mcap").stat().st_size
    kept = list(read_results(tmp_path / "results.jsonl"))
    assert [each.segment for each in kept] == [0] * FIRST + [1] * SECOND
    # The run's clock continues where the source's started again.
    clock = [each.offset_s + each.time for each in kept]
    assert clock == sorted(set(clock))
    assert clock[-1] - clock[0] == pytest.approx(done.duration_s)
    assert {body["role"] for each in kept for body in each.truth} == {"observer", "obstacle"}


def test_after_a_restart_truth_is_that_of_the_frame_and_not_of_its_repeated_time(
    tmp_path: Path, lab: OpenedSource, frames: tuple[StereoFrame, ...]
) -> None:
    recorded(tmp_path / "recording.mcap", lab, frames, driven=True)
    rerun(job(tmp_path), lambda *_: None)
    speeds = {
        part: [
            max(body["speed"] for body in each.truth if body["role"] == "obstacle")
            for each in read_results(tmp_path / "results.jsonl")
            if each.segment == part
        ]
        for part in (0, 1)
    }
    assert (len(speeds[0]), len(speeds[1])) == (FIRST, SECOND)
    assert min(speeds[0]) > 0.1
    assert speeds[1] == [0.0] * SECOND


def test_other_parameters_are_recorded_with_the_rerun(
    tmp_path: Path, lab: OpenedSource, frames: tuple[StereoFrame, ...]
) -> None:
    lines = recorded(tmp_path / "recording.mcap", lab, frames)
    wanted = job(tmp_path, **preset("paper").flat())
    rerun(wanted, lambda *_: None)
    with Recording(tmp_path / "again.mcap") as again:
        (revision,) = again.parameter_revisions()
        assert revision.values == wanted.parameters
        assert bare(list(again.lines())) != bare(lines)


def test_a_recording_without_images_is_refused(
    tmp_path: Path, lab: OpenedSource, frames: tuple[StereoFrame, ...]
) -> None:
    recorded(tmp_path / "recording.mcap", lab, frames, "none")
    with pytest.raises(SourceError, match="without images"):
        rerun(job(tmp_path), lambda *_: None)
    assert not (tmp_path / "again.mcap").exists()
