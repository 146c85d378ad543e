"""The length of runs whose rows do not give it: older ones, and interrupted ones."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import pytest

from app.server.runs.recording import complete_recording, measure_run
from app.storage import RunState, Storage
from observer.calibration.formats.opencv_file import calibration_text
from observer.opening import open_source
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.run_folder import RECORDING
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

FRAMES = 4


def _record(path: Path, *, finished: bool) -> None:
    source = open_source("simulated:lab").source
    assert source.calibration is not None
    path.parent.mkdir(parents=True)
    facts = RunFacts(
        id="a", name="a", source="simulated:lab", info=asdict(source.info), images="none",
        calibration_yaml=calibration_text(source.calibration),
    )  # fmt: skip
    writer = RecordingWriter(path, facts)
    for _ in range(FRAMES):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        writer.frame(frame)
    if finished:
        writer.finish()
    else:
        # As if killed after the chunk was written.
        writer.flush(time.monotonic() + 10.0)
        assert writer._own_file is not None
        writer._own_file.close()
    source.close()


def test_an_old_run_without_a_length_gets_that_of_its_recording(storage: Storage) -> None:
    storage.open()
    old = storage.create_run(name="old", source="s", parameters={}, versions={})
    storage.update_run(old.id, frames=FRAMES, state=RunState.FINISHED)
    lost = storage.create_run(name="no recording", source="s", parameters={}, versions={})
    storage.update_run(lost.id, frames=9, state=RunState.FINISHED)
    empty = storage.create_run(name="no frame", source="s", parameters={}, versions={})
    storage.update_run(empty.id, state=RunState.FINISHED)
    assert set(storage.unmeasured_runs()) == {old.id, lost.id}
    _record(storage.folder.run(old.id) / RECORDING, finished=True)
    before = storage.get_run(old.id)
    for run_id in storage.unmeasured_runs():
        measure_run(storage, run_id)
    assert storage.unmeasured_runs() == [lost.id]
    kept = storage.get_run(old.id)
    assert before is not None
    assert kept is not None
    assert kept.duration_s == pytest.approx((FRAMES - 1) / 15)
    assert (kept.begin_s, kept.ended_at) == (0.0, before.ended_at)


def test_an_interrupted_run_is_as_long_as_its_recording(storage: Storage) -> None:
    storage.open()
    run = storage.create_run(name="cut", source="s", parameters={}, versions={})
    # The last heartbeat was before the recording's last chunk.
    storage.update_run(run.id, frames=1, begin_s=0.0, duration_s=0.0)
    path = storage.folder.run(run.id) / RECORDING
    _record(path, finished=False)
    storage.mark_interrupted_runs()
    complete_recording(storage, run.id)
    with Recording(path) as recording:
        assert not recording.unfinished
    kept = storage.get_run(run.id)
    assert kept is not None
    assert (kept.state, kept.frames) == (RunState.INTERRUPTED, FRAMES)
    assert kept.duration_s == pytest.approx((FRAMES - 1) / 15)
