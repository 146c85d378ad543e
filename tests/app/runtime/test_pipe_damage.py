"""Damaged, truncated and hostile bytes between the processes: a channel error, or its end."""

from __future__ import annotations

import asyncio
import io
import pickle
import socket
import struct
import sys
import threading
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.contract.commands import StopRun
from app.contract.events import EngineState, StateEvent
from app.runtime.child import ChildEnded, ChildProcess
from app.runtime.errors import ChannelError
from app.runtime.lifeline import receive_until_parent_ends
from app.runtime.pipe import MAX_MESSAGE_BYTES, encode, load_message, read_message
from app.runtime.requests import Reply, Request
from app.runtime.worker import JobFailed, LastingWorker, Worker

from ...damage import assert_one_sentence, damaged, examples, hostile_bytes, read_or_refused

SENT = (
    Request(1, StopRun()),
    Reply(7, {"jpeg": b"\0" * 300}, None, None),
    StateEvent(EngineState.FAILED, "the camera is gone"),
    "a text with the number 1234",
    (),
)
WIRE = b"".join(map(encode, SENT))
# Pickle opcodes: a memo index and sizes that allocate memory; a class and a function to call.
PIECES = (
    b"\x80\x05", b".", b"r\xff\xff\xff\x7f", b"\x96" + b"\xff" * 7 + b"\x7f",
    b"B\xff\xff\xff\x7f", b"cos\nsystem\n", b"cbuiltins\nexec\n", b"R", b"\x93", b"\x94",
    b"\0\0\0\x01", b"\0\0\0\0\0\0\0\0", struct.pack(">I", MAX_MESSAGE_BYTES),
    struct.pack(">I", MAX_MESSAGE_BYTES + 1), encode("another"),
)  # fmt: skip
# One message, or one and the beginning of the next.
GARBAGE = encode("whole") + b"\0\0\0\x04damaged!"


def framed(body: bytes) -> bytes:
    return struct.pack(">II", len(body), zlib.crc32(body)) + body


def blocking(wire: bytes) -> list[Any]:
    stream = io.BytesIO(wire)
    return list(iter(lambda: load_message(stream), None))


def asynchronous(wire: bytes) -> list[Any]:
    async def read() -> list[Any]:
        reader = asyncio.StreamReader()
        reader.feed_data(wire)
        reader.feed_eof()
        messages = []
        async with asyncio.timeout(10):
            while (message := await read_message(reader)) is not None:
                messages.append(message)
        return messages

    return asyncio.run(read())


READERS = pytest.mark.parametrize("read", [blocking, asynchronous])


@READERS
@examples(60)
@given(damaged([WIRE, *map(encode, SENT)], PIECES) | hostile_bytes((WIRE, *PIECES)))
def test_damaged_bytes_are_never_taken_for_a_message(
    read: Callable[[bytes], list[Any]], wire: bytes
) -> None:
    messages = read_or_refused(lambda: read(wire), ChannelError)
    assert all(message in (*SENT, "another") for message in messages or ())


@READERS
@given(at=st.integers(0, len(WIRE) - 1), flipped=st.integers(1, 255))
@examples(60)
def test_one_wrong_byte_is_detected_anywhere(
    read: Callable[[bytes], list[Any]], at: int, flipped: int
) -> None:
    wire = WIRE[:at] + bytes((WIRE[at] ^ flipped,)) + WIRE[at + 1 :]
    messages = read_or_refused(lambda: read(wire), ChannelError)
    # A message that claims to be longer than the rest counts as the end.
    assert messages is None or messages == list(SENT[: len(messages)]) != list(SENT)


class _Angry:
    """Can be pickled, but raises when it is unpickled."""

    def __init__(self, error: type[BaseException]) -> None:
        self.error = error

    def __reduce__(self) -> tuple[Any, ...]:
        return _raise, (self.error,)


def _raise(error: type[BaseException]) -> None:
    raise error("several\nlines")


@READERS
@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"\x80\x05",
        b"\x80\x05.",
        b"\x80\xff.",
        b"no pickle",
        pickle.dumps("cut off")[:-3],
        b"cno_such_module\nName\n.",
        b"capp.runtime.pipe\nno_such_name\n.",
        b"cdatetime\ndate\n(I0\nI99\nI-1\ntR.",
        # More memory than the address space has.
        b"\x80\x05\x96" + b"\xff" * 7 + b"\x0f.",
        b"\x80\x05B\xff\xff\xff\x7f.",
        b"(" * 10_000 + b"t" * 10_000,
        *(pickle.dumps(_Angry(each)) for each in (KeyError, RecursionError, MemoryError, OSError)),
    ],
    ids=lambda body: repr(body[:24]),
)
def test_a_complete_message_that_cannot_be_unpickled_is_refused(
    read: Callable[[bytes], list[Any]], body: bytes
) -> None:
    with pytest.raises(ChannelError, match="cannot be loaded") as refused:
        read(framed(body))
    assert_one_sentence(str(refused.value))


# ---------------------------------------------------------------------- what hears it


def test_a_process_exits_when_it_can_no_longer_read_its_parent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    here, there = socket.socketpair()
    heard: list[Any] = []
    left = threading.Event()
    with here, there:
        receive_until_parent_ends(there, heard.append, expects_end=lambda: False, leave=left.set)
        # The parent is alive, so this is not the end of the channel.
        here.sendall(GARBAGE)
        assert left.wait(10), "it goes on without hearing anything"
    assert heard == ["whole"]
    assert "lost contact with the server: a message of 4 bytes arrived damaged" in caplog.text


async def test_a_child_that_sends_garbage_counts_as_ended(caplog: pytest.LogCaptureFixture) -> None:
    code = (
        "import socket, sys, time; "
        "s = socket.socket(fileno=int(sys.argv[sys.argv.index('--channel') + 1])); "
        f"s.recv(1); s.sendall({GARBAGE!r}); time.sleep(60)"
    )
    heard: list[Any] = []
    child = await ChildProcess.start(
        [sys.executable, "-S", "-c", code], {}, lambda _, event: heard.append(event)
    )
    try:
        with pytest.raises(ChildEnded):
            await child.request(StopRun(), timeout_s=30)
        assert child.ended
    finally:
        await child.remove()
    assert heard == ["whole", None]
    assert child.reap()
    assert f"process {child.pid}: a message of 4 bytes arrived damaged" in caplog.text


@pytest.fixture
def garbling(tmp_path: Path, repository: Path) -> Worker:
    """A worker that answers with an invalid message, and waits."""
    (tmp_path / "garbling.py").write_text(
        "import os, sys, time\n"
        "sys.stdin.buffer.read(1)\n"
        f"os.write(1, {GARBAGE.removeprefix(encode('whole'))!r})\n"
        "time.sleep(60)\n"
    )
    return Worker("garbling", 0, {"PYTHONPATH": f"{repository}:{tmp_path}"})


async def test_a_job_whose_worker_sends_garbage_fails_with_a_short_reason(garbling: Worker) -> None:
    with pytest.raises(JobFailed, match="was lost: a message of 4 bytes") as failed:
        await garbling.do("a job", lambda _: None)
    assert_one_sentence(str(failed.value))
    assert psutil.Process().children() == []


def test_a_lasting_worker_that_sends_garbage_is_ended(
    garbling: Worker, caplog: pytest.LogCaptureFixture
) -> None:
    worker = LastingWorker(garbling, longest_s=30)
    try:
        assert worker.do("a job", str) is None
        assert psutil.Process().children() == []
    finally:
        worker.close()
    assert "garbling cannot be used: a message of 4 bytes arrived damaged" in caplog.text
