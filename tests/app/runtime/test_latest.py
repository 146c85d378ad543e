"""The latest value through shared memory: whole or not at all, whatever happens meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.runtime.errors import ChannelError
from app.runtime.latest import LatestReader, LatestWriter, create_slot

# Writes values as quickly as it can; each payload is one repeated byte, so a mixture shows.
HAMMER = """
import sys
from app.runtime.latest import LatestWriter
fd, size = int(sys.argv[1]), int(sys.argv[2])
writer = LatestWriter(fd)
blocks = [bytes([value]) * size for value in range(256)]
number = 0
while True:
    writer.write({"value": number % 256}, blocks[number % 256][: size - number % 7])
    number += 1
    if number == 2:
        print("ready", flush=True)
"""


@pytest.fixture
def slot() -> Iterator[int]:
    fd = create_slot(200_000)
    yield fd
    os.close(fd)


def test_an_empty_slot_reads_as_none(slot: int) -> None:
    assert LatestReader(slot).read() is None


def test_newest_value_wins_and_is_read_once(slot: int) -> None:
    writer, reader = LatestWriter(slot), LatestReader(slot)
    for number in range(1, 6):
        assert writer.write({"number": number}, bytes([number]) * number) == number
    latest = reader.read(after=0)
    assert latest is not None
    assert (latest.sequence, latest.header, latest.payload) == (5, {"number": 5}, b"\x05" * 5)
    assert reader.read(after=5) is None
    assert reader.read(after=4) is not None


@settings(max_examples=40)
@given(
    values=st.lists(
        st.tuples(
            st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=5), max_size=4),
            st.lists(st.binary(max_size=300), max_size=3),
        ),
        min_size=1,
        max_size=5,
    )
)
def test_written_values_are_read_back(values: list[tuple[dict[str, object], list[bytes]]]) -> None:
    fd = create_slot(4096)
    try:
        writer, reader = LatestWriter(fd), LatestReader(fd)
        for sequence, (header, parts) in enumerate(values, start=1):
            writer.write(header, *parts)
            latest = reader.read(after=sequence - 1)
            assert latest is not None
            assert latest.header == header
            assert latest.payload == b"".join(parts)
        writer.close()
        reader.close()
    finally:
        os.close(fd)


def test_arrays_are_concatenated_as_bytes(slot: int) -> None:
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3)
    LatestWriter(slot).write({"count": 4}, points.data, colors.data)
    latest = LatestReader(slot).read()
    assert latest is not None
    assert latest.payload == points.tobytes() + colors.tobytes()


def test_an_oversized_value_is_refused_and_the_old_one_stays(slot: int) -> None:
    writer, reader = LatestWriter(slot), LatestReader(slot)
    writer.write({"kept": True}, b"old")
    with pytest.raises(ChannelError, match=r"200014 bytes does not fit .* 200000 bytes"):
        writer.write({"kept": False}, b"n" * 200_000)
    latest = reader.read()
    assert latest is not None
    assert latest.payload == b"old"
    assert latest.header == {"kept": True}


def test_a_successor_continues_the_sequence(slot: int) -> None:
    LatestWriter(slot).write({}, b"first")
    assert LatestWriter(slot).write({}, b"second") == 2


def test_a_writer_killed_mid_write_leaves_the_previous_value(slot: int) -> None:
    writer, reader = LatestWriter(slot), LatestReader(slot)
    writer.write({}, b"whole")
    # What a kill -9 in the middle of the next write leaves: its buffer marked as being written.
    word = 4 + (2 % 2) * 4
    writer._words[word] = 0
    latest = reader.read()
    assert latest is not None
    assert latest.payload == b"whole"


def test_a_damaged_value_is_not_returned(slot: int) -> None:
    writer, reader = LatestWriter(slot), LatestReader(slot)
    writer.write({}, b"x" * 1000)
    raw = writer._bytes
    at = bytes(raw).index(b"x" * 1000)
    raw[at + 500 : at + 501] = b"y"
    assert reader.read() is None


def test_a_descriptor_that_is_not_a_slot_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other"
    path.write_bytes(bytes(4096))
    with path.open("r+b") as file, pytest.raises(ChannelError, match="no latest-value slot"):
        LatestReader(file.fileno())


@contextmanager
def _hammered(size: int) -> Iterator[tuple[LatestReader, subprocess.Popen[bytes]]]:
    """A slot that another process writes without a pause; it is killed at the end."""
    fd = create_slot(size + 100)
    reader = LatestReader(fd)
    process = subprocess.Popen(
        [sys.executable, "-c", HAMMER, str(fd), str(size)],
        pass_fds=[fd],
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        yield reader, process
    finally:
        process.kill()
        process.communicate()
        reader.close()
        os.close(fd)


def test_values_are_never_torn_under_a_continuous_writer() -> None:
    size = 150_000
    with _hammered(size) as (reader, writer):
        seen, last = 0, 0
        until = time.monotonic() + 1.5
        while time.monotonic() < until:
            latest = reader.read(after=last)
            if latest is None:
                continue
            assert latest.sequence > last
            last = latest.sequence
            value = latest.header["value"]
            assert value == (last - 1) % 256
            assert len(latest.payload) == size - (last - 1) % 7
            assert latest.payload == bytes([value]) * len(latest.payload)
            seen += 1
        assert seen > 20
        # kill -9 at any instant: a whole value can still be read.
        writer.kill()
        writer.wait()
        final = reader.read()
        assert final is not None
        assert len(set(final.payload)) == 1


def test_the_stress_test_detects_a_reader_without_checks() -> None:
    """The same stress on the raw memory does find mixtures, so the test above can fail."""
    size = 150_000
    with _hammered(size) as (reader, _):
        until = time.monotonic() + 20
        mixed = False
        while not mixed and time.monotonic() < until:
            data = bytes(reader._bytes[96 + 100 : 96 + size - 100])
            mixed = len(set(data)) > 1
        assert mixed
