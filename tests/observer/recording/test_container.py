"""Recordings cut off before their end, full disks, and what other tools can read."""

from __future__ import annotations

import errno
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

from observer.errors import SourceError
from observer.recording import topics
from observer.recording.container import Container
from observer.recording.contents import find_contents
from observer.recording.errors import RecordingError
from observer.recording.payloads import Incident, RunFacts
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter, complete
from observer.types import StereoFrame

MESSAGES, PER_CHUNK = 40, 5


def small_file(*, finish: bool) -> tuple[bytes, list[int]]:
    """Return 40 messages, 5 per chunk, and where each chunk with its indexes ends."""
    file, ends = BytesIO(), []
    container = Container(file, "small")
    for k in range(MESSAGES):
        container.add(topics.INCIDENT, k, 1000 + k, b'{"k": %d}' % k)
        if k % PER_CHUNK == PER_CHUNK - 1:
            container.write_chunks()
            ends.append(container.size)
    if finish:
        container.finish()
    return file.getvalue(), ends


class CutFile(BytesIO):
    """A disk with limited room; like a real one it writes as much as still fits."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self._room = room

    def write(self, data: object) -> int:
        view = memoryview(data)  # type: ignore[arg-type]
        fits = min(len(view), self._room - self.tell())
        if fits <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(view[:fits])


def numbers(data: bytes) -> list[int]:
    """Return what a file of made-up messages holds, read by our own reader."""
    from observer.recording.contents import chunk_records, find_contents, messages_of

    file = BytesIO(data)
    contents = find_contents(file, "small")
    return [
        json.loads(bytes(message.data))["k"]
        for chunk in contents.chunks
        for message in messages_of(chunk_records(file, chunk, "small"))
    ]


WHOLE, ENDS = small_file(finish=True)


@settings(max_examples=150)
@given(st.integers(8, len(WHOLE)))
def test_a_truncated_file_is_read_up_to_its_last_whole_chunk(length: int) -> None:
    cut = WHOLE[:length]
    # A chunk counts once it is complete, even if its indexes are cut off.
    at_least = sum(end <= length for end in ENDS) * PER_CHUNK
    found = numbers(cut)
    assert found == list(range(len(found)))
    assert at_least <= len(found) <= at_least + PER_CHUNK


@settings(max_examples=60)
@given(st.integers(300, len(WHOLE)))
def test_a_truncated_file_can_be_resumed_and_is_then_complete(length: int) -> None:
    kept = len(numbers(WHOLE[:length]))
    file = BytesIO(WHOLE[:length])
    container = Container(file, "small", resume=True)
    for k in range(kept, MESSAGES):
        container.add(topics.INCIDENT, k, 1000 + k, b'{"k": %d}' % k)
    container.finish()
    whole = file.getvalue()
    assert numbers(whole) == list(range(MESSAGES))
    summary = make_reader(BytesIO(whole)).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == MESSAGES
    read = [json.loads(m.data)["k"] for _, _, m in make_reader(BytesIO(whole)).iter_messages()]
    assert read == list(range(MESSAGES))


@settings(max_examples=60)
@given(st.integers(200, len(WHOLE) - 1))
def test_a_full_disk_ends_the_file_and_leaves_what_was_written(room: int) -> None:
    file = CutFile(room)
    container = Container(file, "small")

    def write() -> None:
        for k in range(MESSAGES):
            container.add(topics.INCIDENT, k, 1000 + k, b'{"k": %d}' % k)
            if k % PER_CHUNK == PER_CHUNK - 1:
                container.write_chunks()
        container.finish()

    with pytest.raises(RecordingError, match="the disk is full; everything written") as told:
        write()
    assert told.value.full
    data = file.getvalue()
    found = numbers(data)
    # The index fits if the chunk that did not fit left enough room for it.
    at_least = sum(end <= room for end in ENDS) * PER_CHUNK
    assert found == list(range(at_least))
    assert len(data) == container.size or data.endswith(b"\x89MCAP0\r\n")
    with pytest.raises(RecordingError):
        container.add(topics.INCIDENT, 0, 5000, b"{}")
    # Freeing space does not make this writer continue, but a new writer can.
    again = BytesIO(data)
    Container(again, "small", resume=True).finish()
    assert numbers(again.getvalue()) == found


@settings(max_examples=200)
@given(st.integers(8, len(WHOLE) - 1), st.integers(0, 255))
def test_a_damaged_byte_is_reported_or_harmless(at: int, value: int) -> None:
    data = bytearray(WHOLE)
    data[at] = value
    try:
        found = numbers(bytes(data))
    except SourceError:
        return
    assert set(found) <= set(range(MESSAGES))


def test_a_file_size_limit_ends_a_recording_like_a_full_disk(
    tmp_path: Path, facts: Callable[..., RunFacts]
) -> None:
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, facts("none"))
    written: list[int] = []

    def write() -> None:
        for k in range(100_000):
            noise = np.random.default_rng(k).bytes(100).hex()
            writer.incident(Incident(kind="noise", sentence=noise, received=time.monotonic()))
            writer.flush(time.monotonic() + 10.0)
            written.append(k)

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, hard))
    try:
        with pytest.raises(RecordingError, match="ended because the disk is full") as told:
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    writer.finish()
    assert told.value.full
    assert path.stat().st_size <= 60_000
    with Recording(path) as recording:
        # Each was on disk before the next was written.
        assert [i.kind for i in recording.incidents()] == ["noise"] * len(written)


@pytest.mark.parametrize("images", ["jpeg", "lossless", "none"])
def test_the_mcap_library_reads_every_message(
    images: str, write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    path = write_run(tmp_path / "recording.mcap", images)
    for reader_of in (make_reader, lambda file: NonSeekingReader(file, validate_crcs=True)):
        with path.open("rb") as file:
            reader = reader_of(file)
            count: dict[str, int] = {}
            last = 0
            for schema, channel, message in reader.iter_messages(log_time_order=True):
                assert schema is not None
                assert schema.data
                assert message.log_time >= last
                last = message.log_time
                count[channel.topic] = count.get(channel.topic, 0) + 1
        assert count[topics.FRAME.name] == count[topics.OBSERVATION.name] == len(frames)
        expected = 0 if images == "none" else len(frames)
        assert count.get(topics.LEFT_RAW.name, 0) == expected
        assert count.get(topics.RIGHT_RAW.name, 0) == expected


def test_an_unfinished_file_is_unchanged_by_reading_and_completed_on_demand(
    write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    path = write_run(tmp_path / "recording.mcap", finish=False)
    before = path.read_bytes()
    with Recording(path) as recording:
        assert recording.unfinished
        assert len(recording.frames) == len(frames)
        np.testing.assert_array_equal(recording.pair(7)[1], frames[7].right)
    assert path.read_bytes() == before
    complete(path)
    with Recording(path) as recording:
        assert not recording.unfinished
        assert len(recording.frames) == len(list(recording.lines())) == len(frames)
    with path.open("rb") as file:
        assert make_reader(file).get_summary() is not None


def test_a_run_is_resumed_in_its_unfinished_file(
    write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    path = write_run(tmp_path / "recording.mcap", finish=False)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 100)
    with Recording(path) as recording:
        kept = len(recording.frames)
    writer = RecordingWriter.resume(path)
    for frame in frames[:3]:
        writer.frame(frame)
    writer.finish()
    source = RecordingSource(path)
    read = []
    while (item := source.read()) is not None:
        assert isinstance(item, StereoFrame)
        read.append((item, source.begins))
    source.close()
    assert len(read) == kept + 3
    for (frame, begins), old in zip(read[-3:], frames[:3], strict=True):
        np.testing.assert_array_equal(frame.left, old.left)
        assert begins == ("observer" if old is frames[0] else None)


def test_a_killed_process_loses_less_than_a_second(tmp_path: Path) -> None:
    """Fault 21, for the recording alone: everything older than a second is there."""
    path = tmp_path / "recording.mcap"
    script = f"""
import sys, time
from pathlib import Path
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.recording.payloads import Incident, RunFacts
from observer.recording.writer import RecordingWriter
text = calibration_text(StereoCalibration.rectified(64, 48, 50, 50, 32, 24, 0.1))
facts = RunFacts(id="k", name="k", source="none", info={{}}, calibration_yaml=text, images="none")
writer = RecordingWriter(Path({str(path)!r}), facts)
print("go", flush=True)
while True:
    now = time.monotonic()
    writer.incident(Incident(kind="tick", sentence="tick", received=now))
    print(now, flush=True)
    time.sleep(0.01)
"""
    worst = 0.0
    for trial in range(2):
        path.unlink(missing_ok=True)
        with subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True
        ) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == "go\n"
            time.sleep(0.9 + 0.13 * trial)
            child.kill()
            told = [float(line) for line in child.stdout.read().split()]
        with Recording(path) as recording:
            kept = [incident.received for incident in recording.incidents()]
        assert kept == told[: len(kept)]
        worst = max(worst, told[-1] - kept[-1])
    print(f"lost at most {worst:.2f} s")  # noqa: T201
    assert worst < 1.0


@pytest.mark.parametrize("kept", [0.6, 0.9, 0.97])
def test_a_run_is_resumed_wherever_its_file_was_truncated(
    kept: float, write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    """This includes topics that were declared after the last whole chunk."""
    path = write_run(tmp_path / "recording.mcap", "jpeg")
    with path.open("r+b") as file:
        file.truncate(int(path.stat().st_size * kept))
    writer = RecordingWriter.resume(path)
    for frame in frames[:3]:
        writer.frame(frame)
    writer.incident(Incident(kind="new topic", sentence="x", received=frames[0].received))
    writer.finish()
    with Recording(path) as recording:
        count = len(recording.frames)
        assert count >= 3
        np.testing.assert_array_equal(recording.pair(count - 1)[0].shape, frames[2].left.shape)
        assert [i.kind for i in recording.incidents()] == ["new topic"]
    for reader_of in (make_reader, lambda file: NonSeekingReader(file, validate_crcs=True)):
        with path.open("rb") as whole:
            topics_read = [channel.topic for _, channel, _ in reader_of(whole).iter_messages()]
        assert topics_read.count(topics.FRAME.name) == count


def test_a_file_that_is_not_a_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with pytest.raises(SourceError, match=r"x\.mcap cannot be read: No such file"):
        Recording(path)
    for content, words in (
        (b"", "is not an MCAP file"),
        (b"hello, this is text and no recording", "is not an MCAP file"),
        (WHOLE, "is not a recording of a run"),
        (WHOLE[:9], "is not a recording of a run"),
    ):
        path.write_bytes(content)
        with pytest.raises(SourceError, match=words):
            RecordingSource(path)


def test_playing_a_recording_without_images_is_refused(
    write_run: Callable[..., Path], tmp_path: Path
) -> None:
    path = write_run(tmp_path / "recording.mcap", "none")
    with pytest.raises(SourceError, match="was recorded without images"):
        RecordingSource(path)


def test_a_killed_writer_leaves_no_observation_without_its_truth(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    frames: tuple[StereoFrame, ...],
    facts: Callable[..., RunFacts],
    line: Any,
) -> None:
    # Every call ends a chunk, after which the writer may be killed.
    monkeypatch.setattr("observer.recording.writer.CHUNK_S", 0.0)
    path, cut = tmp_path / "recording.mcap", tmp_path / "cut.mcap"
    body = {
        "id": 1, "name": "cart", "role": "obstacle", "position": [0.0, 0.0, 3.0],
        "velocity": [0.5, 0.0, 0.0], "speed": 0.5, "size": [0.4, 0.4, 0.3], "yaw": 0.0,
        "visible": 1.0, "commanded_speed": None, "track_id": 3,
    }  # fmt: skip
    sizes = []
    writer = RecordingWriter(path, facts("none"))
    for frame in frames[:5]:
        writer.frame(frame)
        writer.observation(line(frame), frame.received, truth=[body])
        sizes.append(writer.size)
    writer.finish()
    content = path.read_bytes()
    with path.open("rb") as file:
        ends = [chunk.end for chunk in find_contents(file, path.name).chunks]
    assert len(ends) > 2 * len(sizes)
    for end in ends[1:]:
        cut.write_bytes(content[:end])
        with Recording(cut) as recording:
            assert len(list(recording.lines())) == len(list(recording.matched_truth()))


@pytest.mark.parametrize("lost", ["index", "chunk", "both"])
@pytest.mark.parametrize("where", ["first", "middle"])
def test_damage_costs_only_the_images_there(
    lost: str,
    where: str,
    write_run: Callable[..., Path],
    tmp_path: Path,
    frames: tuple[StereoFrame, ...],
) -> None:
    path = write_run(tmp_path / "recording.mcap")
    with path.open("rb") as file:
        images = make_reader(file).iter_messages([topics.LEFT_RAW.name], log_time_order=False)
        times = [message.log_time for _, _, message in images]
        contents = find_contents(file, path.name)
    left = contents.channel_ids(topics.LEFT_RAW.name)
    chunks = [chunk for chunk in contents.chunks if left & set(chunk.channels)]
    chunk = chunks[0 if where == "first" else len(chunks) // 2]
    span = chunk.index.message_start_time, chunk.index.message_end_time
    within = {k for k, time in enumerate(times) if span[0] <= time <= span[1]}
    middle = chunk.offset + chunk.index.chunk_length
    begin, end = {
        "index": (middle, chunk.end),
        "chunk": (chunk.offset + 200, middle),
        "both": (chunk.offset + 200, chunk.end),
    }[lost]
    content = bytearray(path.read_bytes())
    content[begin:end] = bytes(end - begin)
    path.write_bytes(content)
    source = RecordingSource(path)
    read = []
    while (item := source.read()) is not None:
        read.append(item)
    source.close()
    assert len(read) == len(frames)
    assert 0 < len(within) < len(frames)
    missing = set() if lost == "index" else within
    assert {k for k, item in enumerate(read) if not isinstance(item, StereoFrame)} == missing
    for item, frame in zip(read, frames, strict=True):
        if isinstance(item, StereoFrame):
            np.testing.assert_array_equal(item.left, frame.left)
