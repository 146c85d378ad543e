"""Messages between the processes: whole, in order, never blocking the engine, never unbounded."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.contract.commands import StopRun
from app.contract.events import (
    EngineState,
    HeartbeatEvent,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
)
from app.runtime import pipe
from app.runtime.errors import ChannelError
from app.runtime.pipe import MessageSender, encode, load_message, read_message
from app.runtime.requests import Reply, Request


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    here, there = socket.socketpair()
    with here, there:
        yield here, there


def observation(sequence: int, size: int = 10) -> ObservationEvent:
    line: Any = {"text": "x" * size}
    return ObservationEvent(sequence, line, [], 0.0, 0.0, 0, None)


def engine_sender(sock: socket.socket, backlog: int = pipe.DEFAULT_BACKLOG) -> MessageSender:
    return MessageSender(
        sock,
        latest=(HeartbeatEvent,),
        droppable=(ObservationEvent, SkippedFrameEvent),
        backlog=backlog,
    )


def drain(sock: socket.socket) -> list[Any]:
    messages, stream = [], sock.makefile("rb")
    while (message := load_message(stream)) is not None:
        messages.append(message)
    return messages


def test_messages_arrive_whole_and_in_order(pair: tuple[socket.socket, socket.socket]) -> None:
    here, there = pair
    sent = [Request(1, StopRun()), Reply(1, {"jpeg": b"\0" * 300_000}), observation(0)]
    sender = engine_sender(here)
    reader = threading.Thread(target=lambda: received.extend(drain(there)))
    received: list[Any] = []
    reader.start()
    for message in sent:
        sender.send(message)
    sender.close()
    here.close()
    reader.join(10)
    assert received == sent


@settings(max_examples=25)
@given(
    texts=st.lists(st.text(max_size=200), max_size=6), cuts=st.lists(st.integers(1, 50), min_size=1)
)
async def test_the_asynchronous_reader_accepts_any_fragmentation(
    texts: list[str], cuts: list[int]
) -> None:
    wire = b"".join(encode(text) for text in texts)
    reader = asyncio.StreamReader()
    messages: list[Any] = []

    async def feed() -> None:
        at, turn = 0, 0
        while at < len(wire):
            size = cuts[turn % len(cuts)]
            reader.feed_data(wire[at : at + size])
            at, turn = at + size, turn + 1
            await asyncio.sleep(0)
        reader.feed_eof()

    feeding = asyncio.create_task(feed())
    while (message := await read_message(reader)) is not None:
        messages.append(message)
    await feeding
    assert messages == texts


def test_a_truncated_message_counts_as_the_end(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    here.sendall(encode("whole") + encode("cut off")[:-3])
    here.close()
    assert drain(there) == ["whole"]


def test_an_absurd_length_is_refused(pair: tuple[socket.socket, socket.socket]) -> None:
    here, there = pair
    here.sendall(b"\xff" * 8)
    with pytest.raises(ChannelError, match="out of step"):
        load_message(there.makefile("rb"))


def test_a_slow_reader_loses_only_observations(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    sender = engine_sender(here, backlog=8)
    state = StateEvent(EngineState.IDLE, None)
    begin = time.monotonic()
    for number in range(200):
        sender.send(observation(number, size=20_000))
        sender.send(HeartbeatEvent(float(number)))
        if number % 50 == 0:
            sender.send(Reply(number))
            sender.send(state)
    took = time.monotonic() - begin
    assert took < 2.0, "sending waited for a reader that reads nothing"
    lost = sender.lost(ObservationEvent)
    assert lost > 100
    received: list[Any] = []
    reader = threading.Thread(target=lambda: received.extend(drain(there)))
    reader.start()
    sender.close(10)
    here.close()
    reader.join(10)
    observations = [m.sequence for m in received if isinstance(m, ObservationEvent)]
    assert len(observations) + lost == 200
    assert observations == sorted(observations)
    assert observations[-8:] == list(range(192, 200)), "the newest must survive"
    assert [m.number for m in received if isinstance(m, Reply)] == [0, 50, 100, 150]
    assert received.count(state) == 4
    heartbeats = [m for m in received if isinstance(m, HeartbeatEvent)]
    assert heartbeats[-1].monotonic == 199.0
    assert len(heartbeats) < 100, "waiting heartbeats must not pile up"


def test_skipped_frame_events_are_bounded(pair: tuple[socket.socket, socket.socket]) -> None:
    here, there = pair
    sender = engine_sender(here, backlog=4)
    for number in range(3000):
        sender.send(SkippedFrameEvent(number, "r" * 1000))
    assert sender.lost(ObservationEvent) == 0
    received: list[Any] = []
    reader = threading.Thread(target=lambda: received.extend(drain(there)))
    reader.start()
    sender.close(10)
    here.close()
    reader.join(10)
    assert len(received) < 1500
    assert received[-1].index == 2999


def test_close_returns_even_without_a_reader(pair: tuple[socket.socket, socket.socket]) -> None:
    here, _ = pair
    sender = engine_sender(here)
    for number in range(50):
        sender.send(observation(number, size=100_000))
    begin = time.monotonic()
    sender.close(0.2)
    assert time.monotonic() - begin < 5
    assert not sender._thread.is_alive()


def test_sending_after_the_peer_is_gone_is_harmless(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    there.close()
    sender = engine_sender(here)
    for number in range(10):
        sender.send(observation(number))
        time.sleep(0.01)
    sender.close()
    assert not sender._thread.is_alive()


def test_an_oversized_reply_becomes_a_refusal(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = pair
    monkeypatch.setattr(pipe, "MAX_MESSAGE_BYTES", 1000)
    sender = engine_sender(here)
    sender.send(Reply(7, {"jpeg": b"\0" * 2000}))
    sender.close()
    here.close()
    (reply,) = drain(there)
    assert reply.number == 7
    assert reply.refusal == "failure"
    assert "1000 bytes" in reply.error
