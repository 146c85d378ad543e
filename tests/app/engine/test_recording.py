"""A run's recording beside the loop: nothing waits for the disk; a full disk ends only it."""

from __future__ import annotations

import re
import resource
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from app.contract.commands import OpenSource, RecordOrder
from app.engine.errors import NotNow
from app.engine.playback import PlayedFrame
from app.engine.recorders import Recorders
from app.engine.recording import RunRecorder
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.jsonl import ObservationLine
from observer.navigation.parameters import AllParameters
from observer.recording.errors import RecordingError
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.ring import Ring
from observer.recording.writer import RecordingWriter
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.types import StereoFrame

from ...waiting import until

WIDTH, HEIGHT = 64, 48
INFO = SourceInfo("numbers", "numbers", WIDTH, HEIGHT, 10.0, 5)
CALIBRATION = calibration_text(
    StereoCalibration.rectified(WIDTH, HEIGHT, 60.0, 60.0, 32.0, 24.0, 0.1)
)
FRAME_BYTES = 2 * WIDTH * HEIGHT
FACTS = RunFacts(
    id="r1", name="", source="", info={}, calibration_yaml=CALIBRATION, images="lossless"
)
NO_LINE = cast(ObservationLine, {"no": "line"})


def frame(index: int) -> StereoFrame:
    image = np.full((HEIGHT, WIDTH), index % 256, dtype=np.uint8)
    return StereoFrame(index, index / 10, image, image, received=time.monotonic())


def order(path: Path, **changes: Any) -> RecordOrder:
    return RecordOrder(str(path), "lossless", "a run", **changes)


def command(path: Path, segment: int = 0, **changes: Any) -> OpenSource:
    return OpenSource(
        "numbers", None, {}, 1, run_id="r1", segment=segment, record=order(path, **changes)
    )


def begin(wanted: OpenSource) -> RunRecorder:
    recorder = Recorders().begin(wanted, INFO, CALIBRATION, None)
    assert recorder is not None
    return recorder


def give(recorder: RunRecorder, index: int, *, begins: bool = False) -> None:
    recorder.frame(PlayedFrame(frame(index), index / 10, index, begins))


def ended(recorder: RunRecorder) -> None:
    recorder.end()
    recorder.join(20)
    assert not recorder.is_alive()


def is_finished(path: Path) -> bool:
    with Recording(path) as recording:
        return not recording.unfinished


def frames_in(path: Path) -> list[int]:
    with Recording(path) as recording:
        return [each.index for each in recording.frames]


class SlowWriter:
    """Blocks in a frame until it is released; then it is the writer behind it."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self.gate = threading.Event()

    def frame(self, *args: Any, **more: Any) -> None:
        assert self.gate.wait(20)
        self._writer.frame(*args, **more)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._writer, name)


@pytest.fixture
def file_limit() -> Iterator[Callable[[int], None]]:
    """Let no file of this process exceed a size: EFBIG, as a full disk gives ENOSPC."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_everything_is_written_to_the_file_in_order(tmp_path: Path) -> None:
    path = tmp_path / "runs" / "r1" / "recording.mcap"
    recorder = begin(command(path))
    recorder.skipped(SkippedFrame(7, "frame 7 is damaged"))
    for index in range(5):
        give(recorder, index, begins=index == 3)
    recorder.incident("failed", "a stage broke")
    done = threading.Event()
    recorder.end(done.set)
    assert done.wait(20)
    facts = recorder.facts()
    assert facts.bytes == path.stat().st_size
    assert (facts.images, facts.dropped, facts.trouble) == ("lossless", 0, None)
    with Recording(path) as recording:
        assert not recording.unfinished
        assert [f.begins for f in recording.frames] == ["observer", None, None, "segment", None]
        assert [f.source_position for f in recording.frames] == [0, 1, 2, 3, 4]
        assert np.array_equal(recording.pair(4)[1], frame(4).right)
        assert [s.index for s in recording.skipped()] == [7]
        assert [i.kind for i in recording.incidents()] == ["failed"]


def test_a_stalled_disk_costs_frames_not_time(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    slow = SlowWriter(RecordingWriter(path, FACTS))
    recorder = RunRecorder(slow, order(path), most_bytes=3 * FRAME_BYTES)  # type: ignore[arg-type]
    started = time.monotonic()
    for index in range(100):
        give(recorder, index, begins=index == 50)
    assert time.monotonic() - started < 2.0
    # The queue has room for three, including the one being written.
    assert recorder.facts().dropped == 97
    slow.gate.set()
    until(lambda: not recorder._waiting and recorder._waiting_bytes == 0)
    give(recorder, 100)
    ended(recorder)
    with Recording(path) as recording:
        assert [f.index for f in recording.frames] == [0, 1, 2, 100]
        # If the frame that began a world is lost, the next one begins it.
        assert recording.frames[-1].begins == "segment"
        lost = [re.match(r"(\d+) messages", each.sentence) for each in recording.incidents()]
        # Reported in one sentence, or in two if the disk took a message in between.
        assert sum(int(each[1]) for each in lost if each is not None) == 97


def test_a_stalled_disk_costs_no_change_of_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.engine.recording._MOST_MESSAGES", 5)
    path = tmp_path / "recording.mcap"
    slow = SlowWriter(RecordingWriter(path, FACTS))
    recorder = RunRecorder(slow, order(path))  # type: ignore[arg-type]
    give(recorder, 0)
    for number in range(20):
        recorder.incident("test", f"incident {number}")
    recorder.parameters(AllParameters().changed({"tracking.gate": 2.5}), 1)
    assert recorder.facts().dropped >= 14
    slow.gate.set()
    ended(recorder)
    with Recording(path) as recording:
        (revision,) = recording.parameter_revisions()
    assert revision.values["tracking.gate"] == 2.5


def test_a_full_disk_ends_only_the_recording(
    tmp_path: Path, file_limit: Callable[[int], None]
) -> None:
    path = tmp_path / "recording.mcap"
    recorder = begin(command(path))
    give(recorder, 0)
    until(lambda: frames_in(path))
    file_limit(path.stat().st_size + 50)
    index = 1
    noise = np.random.default_rng(1)
    deadline = time.monotonic() + 20
    while recorder.facts().trouble is None and time.monotonic() < deadline:
        image = noise.integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
        noisy = StereoFrame(index, index / 10, image, image, received=time.monotonic())
        recorder.frame(PlayedFrame(noisy, index / 10, index, False))
        index += 1
        time.sleep(0.02)
    assert "disk is full" in recorder.facts().trouble
    give(recorder, index)
    ended(recorder)
    assert frames_in(path)[0] == 0


def test_a_recording_ends_before_the_disk_is_full(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    first = begin(command(path))
    ended(first)
    left = [500 << 20]
    recorder = RunRecorder(
        RecordingWriter.resume(path), order(path, reserve_bytes=200 << 20), free=lambda _: left[0]
    )
    give(recorder, 0)
    left[0] = 199 << 20
    until(lambda: recorder.facts().trouble)
    assert "only 199 MB are free" in recorder.facts().trouble
    until(lambda: is_finished(path))
    assert frames_in(path) == [0]
    ended(recorder)


def test_a_full_disk_refuses_a_new_run_but_not_a_resumed_one(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    with pytest.raises(RecordingError, match="reserved") as refused:
        begin(command(path, reserve_bytes=1 << 60))
    assert refused.value.full
    assert not path.exists()
    going_on = begin(command(path, segment=1, reserve_bytes=1 << 60))
    assert "reserved" in going_on.facts().trouble
    give(going_on, 0)
    ended(going_on)
    assert not path.exists()


def test_a_resumed_run_is_recorded_in_the_same_file(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    for segment in (0, 1):
        recorder = begin(command(path, segment))
        give(recorder, 3 * segment)
        ended(recorder)
    with Recording(path) as recording:
        assert [(f.index, f.begins) for f in recording.frames] == [(0, "observer"), (3, "observer")]
    path.write_bytes(b"no recording")
    recorder = begin(command(path, 2))
    ended(recorder)
    assert recorder.facts().trouble is None
    assert path.with_suffix(".damaged.mcap").read_bytes() == b"no recording"


def test_invalid_data_ends_the_recording_and_states_the_error(tmp_path: Path) -> None:
    recorder = begin(command(tmp_path / "recording.mcap"))
    recorder.observation(NO_LINE, time.monotonic(), None, [])
    until(lambda: recorder.facts().trouble)
    assert "KeyError" in recorder.facts().trouble
    ended(recorder)


def test_a_clip_that_waits_for_a_failing_recording_is_refused(tmp_path: Path) -> None:
    path, ring = tmp_path / "recording.mcap", Ring()
    slow = SlowWriter(RecordingWriter(path, FACTS, ring=ring))
    recorder = RunRecorder(slow, order(path), ring=ring)  # type: ignore[arg-type]
    give(recorder, 0)
    recorder.observation(NO_LINE, time.monotonic(), None, [])
    told: list[Any] = []
    recorder.save_clip(tmp_path / "clip.mcap", 0, told.append)
    recorder.save_clip(tmp_path / "another.mcap", 0, told.append)
    slow.gate.set()
    until(lambda: len(told) == 2)
    assert [type(each) for each in told] == [RecordingError] * 2
    assert str(told[0]) == recorder.facts().trouble
    with pytest.raises(NotNow, match="KeyError"):
        recorder.save_clip(tmp_path / "clip.mcap", 0, told.append)
    ended(recorder)
    assert len(told) == 2


def test_a_clip_is_refused_if_its_recording_is_given_up_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clip is checked and queued as one: nobody would reply to one queued after the end."""
    path, ring = tmp_path / "recording.mcap", Ring()
    slow = SlowWriter(RecordingWriter(path, FACTS, ring=ring))
    recorder = RunRecorder(slow, order(path), ring=ring)  # type: ignore[arg-type]
    give(recorder, 0)
    recorder.observation(NO_LINE, time.monotonic(), None, [])
    queue_it = recorder._give

    def slowly(*work: Any) -> bool:
        # As if the loop lost its core here, long enough for the recorder to give up.
        slow.gate.set()
        time.sleep(0.2)
        return queue_it(*work)

    monkeypatch.setattr(recorder, "_give", slowly)
    told: list[Any] = []
    recorder.save_clip(tmp_path / "clip.mcap", 0, told.append)
    until(lambda: told)
    assert isinstance(told[0], RecordingError)
    ended(recorder)


@pytest.mark.parametrize("broken", ["ring", "clip"])
def test_a_failed_clip_leaves_the_recording_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    path, clip, ring = tmp_path / "recording.mcap", tmp_path / "clip.mcap", Ring()
    if broken == "ring":
        monkeypatch.setattr(ring, "messages", lambda: 1 // 0)
    else:
        # Deleted as soon as it is complete.
        monkeypatch.setattr(ring, "save", lambda _: None)
    recorder = RunRecorder(RecordingWriter(path, FACTS, ring=ring), order(path), ring=ring)
    told: list[Any] = []
    recorder.save_clip(clip, 0, told.append)
    until(lambda: told)
    assert "the clip clip.mcap could not be saved: internal error" in str(told[0])
    give(recorder, 0)
    ended(recorder)
    assert recorder.facts().trouble is None
    assert frames_in(path) == [0]


def test_an_ended_recording_releases_its_last_half_minute(tmp_path: Path) -> None:
    """A page may keep its final state for long; the next run has a last half minute as well."""
    path, ring = tmp_path / "recording.mcap", Ring()
    writer = RecordingWriter(path, FACTS, ring=ring)
    recorder = RunRecorder(writer, order(path), ring=ring)
    give(recorder, 0)
    told: list[Any] = []
    held = weakref.ref(ring)
    del writer, ring
    recorder.end(lambda: told.append(recorder.facts()))
    recorder.join(20)
    assert told[0].bytes == path.stat().st_size
    assert held() is None
    with pytest.raises(NotNow):
        recorder.save_clip(tmp_path / "ring.mcap", 0, told.append)
