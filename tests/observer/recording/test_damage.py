"""Damaged recordings: read as far as they are intact, or refused in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from observer.errors import InputError, SourceError
from observer.recording import topics
from observer.recording.container import Container
from observer.recording.contents import chunk_records, find_contents, messages_of
from observer.recording.images import field_head, jpeg_pixels, message_fields, raw_pixels
from observer.recording.local_maps import maps_by_frame
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.sources.contract import SkippedFrame

from ...damage import damaged, examples, hostile_bytes, read_or_refused
from .test_container import WHOLE


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "recording.mcap"


def all_of(content: bytes) -> int:
    """Return the number of messages, found with or without the index."""
    file = BytesIO(content)
    contents = find_contents(file, "small")
    return sum(
        len(list(messages_of(chunk_records(file, chunk, "small")))) for chunk in contents.chunks
    )


@examples(80)
@given(damaged([WHOLE], (b"\x06", b"lz4", b"\x89MCAP0\r\n")) | hostile_bytes((WHOLE[:200],)))
def test_a_damaged_file_is_refused_or_read(content: bytes) -> None:
    read_or_refused(lambda: all_of(content), SourceError)


_ITEMS = {
    topics.RUN: b'{"id": "1", "name": "n", "source": "s", "info": {}, "calibration_yaml": "K1",'
    b' "mount": {"height_m": 0.4, "tilt_rad": 0.1, "forward_m": null}}',
    topics.FRAME: b'{"index": 0, "time": 0.0, "received": 1.0, "image": 0}',
    topics.OBSERVATION: b'{"frame": 0, "time": 0.0, "obstacles": []}',
    topics.PARAMETERS: b'{"revision": 1, "values": {"tracking.gate": 3.0}, "frame": 0}',
    topics.TRUTH: b'{"frame": 0, "time": 0.0, "bodies": [{"id": 1, "name": "a", "role": "obstacle",'
    b' "position": [1, 2, 3], "velocity": [0, 0, 0], "size": [1, 1, 1], "yaw": 0.1}],'
    b' "camera_position": [0, 0, 0], "camera_orientation_wxyz": [1, 0, 0, 0]}',
    topics.MATCHED_TRUTH: b'{"frame": 0, "time": 0.0, "bodies": []}',
    topics.MOTION_CAPTURE: b'{"samples": [{"name": "a", "time": 1.0, "received": 2.0,'
    b' "position": [1, 2, 3], "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1]}]}',
    topics.ROBOT: b'{"role": "observer", "received": 1.0}',
    topics.LOCAL_MAP: b'{"frame": 1, "time": 0.1, "map": {"received": 1.0, "x": 0.0, "y": 0.0, '
    b'"cell_m": 0.1, "size": 2, "runs": [1, 2, 1], "robot": [0.0, 0.0, 0.0]}}',
    topics.SKIPPED: b'{"index": 1, "reason": "it is lost"}',
    topics.INCIDENT: b'{"kind": "gap", "sentence": "a gap", "received": 1.0}',
}


def read_all(path: Path) -> None:
    """Read everything that can be read from a recording."""
    with Recording(path) as recording:
        facts = recording.facts
        facts.camera_mount()
        for each in (recording.lines(), recording.robot_rows(), recording.skipped(),
                     recording.incidents(), recording.matched_truth(),
                     recording.parameter_revisions(), recording.frames,
                     maps_by_frame(recording)):  # fmt: skip
            list(each)
        for _, part in recording.truths():
            times = [] if part is None else [sample.time for sample in part.samples]
            assert times == sorted(set(times))
            for body in () if part is None else part.bodies(times[0]):
                assert body.position.shape == (3,)
        recording.truth()
        capture = recording.capture()
        if capture is not None:
            for trajectory in capture.bodies.values():
                assert (np.diff(trajectory.times) > 0).all()
        recording.calibration()


@examples(60)
@given(data=st.data())
def test_malformed_messages_are_refused_or_read(path: Path, data: st.DataObject) -> None:
    items = dict(_ITEMS)
    which = data.draw(st.sampled_from(list(items)))
    items[which] = data.draw(damaged([items[which]], (b"null", b"[]", b"{}")))
    with path.open("wb") as file:
        container = Container(file, path.name)
        for number, (topic, content) in enumerate(items.items()):
            container.add(topic, number, 1000 + number, content)
        container.write_chunks()
        container.finish()
    read_or_refused(lambda: read_all(path), InputError)


@pytest.mark.parametrize("finish", [True, False])
def test_a_damaged_run_is_refused_or_played(
    tmp_path: Path, write_run: Callable[..., Path], path: Path, finish: bool
) -> None:
    whole = write_run(tmp_path / "whole.mcap", "jpeg", finish=finish).read_bytes()

    @examples(4)
    @given(damaged([whole], most=6))
    def play(content: bytes) -> None:
        path.write_bytes(content)
        source = read_or_refused(lambda: RecordingSource(path), InputError)
        if source is None:
            return
        try:
            for _ in range(8):
                frame = source.read()
                if frame is None:
                    break
                if isinstance(frame, SkippedFrame):
                    assert len(frame.reason.splitlines()) == 1
                else:
                    assert np.isfinite(frame.time)
        finally:
            source.close()

    play()


RAW = (
    bytes((2 << 3, 4, 3 << 3, 2, 5 << 3, 4)) + field_head(4, 5) + b"mono8" + field_head(6, 8)
    + bytes(8)
)  # fmt: skip


@examples(60)
@given(damaged([RAW]) | hostile_bytes((b"\x08", b"\xff\xff\xff\xff\xff")))
@example(b"\xff" * 100_000)
@example(bytes((2 << 3,)) + b"\xff" * 300_000 + b"\x01")
def test_a_damaged_image_message_is_refused_or_gives_an_image(content: bytes) -> None:
    message = memoryview(content)
    read_or_refused(lambda: message_fields(message), SourceError)
    for read in (raw_pixels, jpeg_pixels):
        image = read_or_refused(lambda read=read: read(message), SourceError)  # type: ignore[misc]
        assert image is None or image.dtype == np.uint8


def test_an_intact_image_message_is_read() -> None:
    assert raw_pixels(memoryview(RAW)).shape == (2, 4)
