"""A replayed recording gives the run's results, to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer.jsonl import observation_line
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.parameters import Parameters
from observer.recording.payloads import ParameterRevision, RunFacts
from observer.recording.reader import Recording
from observer.recording.replay import replay, replay_revisions
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.types import Observation, StereoFrame

# Frame index -> parameters changed from there on; the run begins a segment at NEW_SEGMENT.
CHANGES: dict[int, dict[str, Any]] = {
    0: {},
    9: {"flow.residual_threshold_px": 1.7, "ego_motion.ransac_iterations": 150},
    16: {"ego_motion.model": "affine"},
}
NEW_SEGMENT = 5


def comparable(observation: Observation) -> dict[str, Any]:
    """Return all of its results except those that depend on the clock."""
    line = {**observation_line(observation, tentative=True)}
    line.pop("timings_ms")
    return line


@pytest.fixture(scope="module")
def live(
    tmp_path_factory: pytest.TempPathFactory, lab: OpenedSource, frames: tuple[StereoFrame, ...]
) -> tuple[Path, list[dict[str, Any]]]:
    """Record a run while parameters change; return its path and results."""
    path = tmp_path_factory.mktemp("run") / "recording.mcap"
    source, mount = lab.source, lab.source.info.mount
    writer = RecordingWriter(path, _facts(lab))
    values: dict[str, Any] = {}
    assert source.calibration is not None
    observer = Observer(source.calibration, mount=mount)
    results = []
    for position, frame in enumerate(frames):
        if position in CHANGES:
            values = {**values, **CHANGES[position]}
            parameters = Parameters().changed(values)
            observer.use(parameters, position)
            flat = dict(parameters.flat())
            revision = ParameterRevision(
                revision=position, values=flat, frame=frame.index, difference=CHANGES[position]
            )
            writer.parameters(revision, frame.received)
        new_segment = position == NEW_SEGMENT
        if new_segment:
            observer.begin_segment()
        writer.frame(frame, begins="segment" if new_segment else None)
        observation = observer.observe(frame)
        writer.observation(observation_line(observation), frame.received)
        results.append(comparable(observation))
    writer.finish()
    return path, results


def _facts(lab: OpenedSource) -> RunFacts:
    from dataclasses import asdict

    from observer.calibration.formats.opencv_file import calibration_text

    source, mount = lab.source, lab.source.info.mount
    assert source.calibration is not None
    assert mount is not None
    return RunFacts(
        id="r1",
        name="replayed",
        source=source.info.spec,
        info=asdict(source.info),
        calibration_yaml=calibration_text(source.calibration),
        mount=asdict(mount),
        images="lossless",
    )


def test_replaying_a_lossless_recording_reproduces_the_results_exactly(
    live: tuple[Path, list[dict[str, Any]]],
) -> None:
    path, results = live
    source = RecordingSource(path)
    replayed = list(map(comparable, replay(source, replay_revisions(source.recording))))
    source.close()
    assert replayed == results
    # They do not agree just because nothing was seen.
    assert sum(len(line["obstacles"]) for line in results) > 5
    assert {line["segment"] for line in results} == {0, 1, 2}
    assert {line["parameters_revision"] for line in results} == set(CHANGES)


def test_other_parameters_give_other_results(live: tuple[Path, list[dict[str, Any]]]) -> None:
    path, results = live
    source = RecordingSource(path)
    revisions = replay_revisions(source.recording, {"ego_motion.model": "homography"})
    replayed = list(map(comparable, replay(source, revisions)))
    source.close()
    assert replayed != results
    assert all(p.ego_motion.model == "homography" for p, _ in revisions.values())


def test_the_lines_of_the_run_are_in_the_recording(
    live: tuple[Path, list[dict[str, Any]]],
) -> None:
    path, results = live
    source = RecordingSource(path)
    lines = list(source.recording.lines())
    source.close()
    for line, result in zip(lines, results, strict=True):
        recorded = {name: value for name, value in line.items() if name != "timings_ms"}
        reported = [o for o in result["obstacles"] if o["state"] != "tentative"]
        assert recorded == {**result, "obstacles": reported}


def test_revisions_are_stored_with_their_changes(
    live: tuple[Path, list[dict[str, Any]]], frames: tuple[StereoFrame, ...]
) -> None:
    source = RecordingSource(live[0])
    revisions = source.recording.parameter_revisions()
    assert [r.frame for r in revisions] == [frames[k].index for k in CHANGES]
    assert [r.difference for r in revisions] == list(CHANGES.values())
    assert source.recording.facts.camera_mount() == source.info.mount
    source.close()


def test_a_change_while_the_engine_is_replaced_is_a_difference(
    write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    path = tmp_path / "recording.mcap"
    write_run(path)
    for revision, values in enumerate([{"a": 1.0, "b": 2.0}, {"a": 1.0, "b": 3.0}], start=1):
        writer = RecordingWriter.resume(path)
        writer.parameters(ParameterRevision(revision=revision, values=values), 0.0)
        writer.frame(frames[0])
        writer.finish()
    with Recording(path) as recording:
        assert [r.difference for r in recording.parameter_revisions()] == [{}, {"b": 3.0}]


def test_open_source_opens_a_recording_with_its_truth(
    write_run: Callable[..., Path], tmp_path: Path, lab: OpenedSource
) -> None:
    opened = open_source(str(write_run(tmp_path / "recording.mcap")))
    assert opened.source.info.kind == "recording"
    assert opened.truth is not None
    assert lab.truth is not None
    for time in (0.0, 0.4):
        true, recorded = lab.truth.bodies(time), opened.truth.bodies(time)
        assert [body.name for body in true] == [body.name for body in recorded]
        for a, b in zip(true, recorded, strict=True):
            np.testing.assert_allclose(a.position, b.position, atol=1e-3)
        pose, again = lab.truth.camera_pose(time), opened.truth.camera_pose(time)
        assert pose is not None
        assert again is not None
        np.testing.assert_allclose(pose.matrix, again.matrix, atol=1e-3)
    opened.source.close()
