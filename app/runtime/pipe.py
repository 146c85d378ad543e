"""Ordered messages between parent and child process over an inherited socket pair.

Each message is a pickle preceded by its length and its CRC-32, 4 bytes big-endian each. Both ends
are the same program and the socket has no name, so nobody else can inject a pickle. A damaged
pickle is never loaded: a single wrong byte may make it allocate gigabytes or call anything.
"""

from __future__ import annotations

import asyncio
import pickle
import socket
import struct
import threading
import zlib
from collections import Counter, deque
from typing import Any, BinaryIO

from app.runtime.errors import ChannelError
from app.runtime.requests import Reply

_HEAD = struct.Struct(">II")
# The largest legitimate message is a calibration preview with two large images.
MAX_MESSAGE_BYTES = 64 * 1024 * 1024
# Four seconds at 15 frames/s: a reader further behind is better served by the newest messages.
DEFAULT_BACKLOG = 64


def encode(message: object) -> bytes:
    """Encode one message as bytes on the wire.

    Raises:
        ChannelError: it is larger than ``MAX_MESSAGE_BYTES``.
    """
    body = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    if len(body) > MAX_MESSAGE_BYTES:
        raise ChannelError(
            f"a {type(message).__name__} of {len(body)} bytes exceeds the largest message, "
            f"{MAX_MESSAGE_BYTES} bytes"
        )
    return _HEAD.pack(len(body), zlib.crc32(body)) + body


def _encode_or_refuse(message: object) -> bytes:
    try:
        return encode(message)
    except ChannelError as error:
        if isinstance(message, Reply):
            # Tell the requester, and keep the thread running for all others.
            return encode(Reply(message.number, error=str(error), refusal="failure"))
        raise


def _announced(head: bytes) -> tuple[int, int]:
    """Return the length and checksum of the message that follows."""
    length, checksum = _HEAD.unpack(head)
    if length > MAX_MESSAGE_BYTES:
        raise ChannelError(f"a message announces {length} bytes: the channel is out of step")
    return length, checksum


def _loaded(body: bytes, checksum: int) -> Any:
    if zlib.crc32(body) != checksum:
        raise ChannelError(f"a message of {len(body)} bytes arrived damaged")
    try:
        return pickle.loads(body)  # nosec B301
    except Exception as error:
        # Loading may raise any exception, including those of the pickled classes.
        kind = type(error).__name__
        raise ChannelError(f"a message of {len(body)} bytes cannot be loaded: {kind}") from error


async def read_message(reader: asyncio.StreamReader) -> Any:
    """Return the next message, or None at the channel's end (the other process is gone).

    Raises:
        ChannelError: the message is damaged; nothing after it can be read.
    """
    try:
        length, checksum = _announced(await reader.readexactly(_HEAD.size))
        body = await reader.readexactly(length)
    except (asyncio.IncompleteReadError, ConnectionError):
        return None
    return _loaded(body, checksum)


def load_message(stream: BinaryIO) -> Any:
    """Wait for the next message of a blocking stream.

    Returns:
        The message; None at the stream's end, even within a message: the other process is gone.

    Raises:
        ChannelError: the message is damaged; nothing after it can be read.
    """
    try:
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        length, checksum = _announced(head)
        body = stream.read(length)
    except ConnectionError:
        return None
    return _loaded(body, checksum) if len(body) == length else None


class MessageSender:
    """Sender of messages with its own thread, so that a slow reader never delays the caller.

    The queue is bounded: of some message types only the newest waits; of others the oldest are
    dropped and counted. All other messages are never dropped; there must be no more of them than
    requests.
    """

    def __init__(
        self,
        sock: socket.socket,
        *,
        latest: tuple[type, ...],
        droppable: tuple[type, ...],
        backlog: int = DEFAULT_BACKLOG,
    ) -> None:
        """Start the thread.

        Args:
            sock: connected socket; its creator closes it.
            latest: message types of which only the newest waits.
            droppable: message types of which the oldest may be dropped.
            backlog: maximum number of waiting droppable messages.
        """
        self._sock = sock
        self._backlog = backlog
        self._latest = latest
        self._droppable = droppable
        self._queue: deque[object] = deque()
        self._waiting_droppable = 0
        self._changed = threading.Condition()
        self._closing = False
        self._broken = False
        self._lost: Counter[type] = Counter()
        self._thread = threading.Thread(target=self._run, name="message sender", daemon=True)
        self._thread.start()

    def lost(self, kind: type) -> int:
        """Return the number of messages of a type dropped because the other process was slow."""
        return self._lost[kind]

    def send(self, message: object) -> None:
        """Queue a message; returns at once."""
        with self._changed:
            if self._closing or self._broken:
                return
            if isinstance(message, self._latest):
                self._drop_first(type(message))
            elif isinstance(message, self._droppable):
                if self._waiting_droppable >= self._backlog:
                    dropped = self._drop_first(*self._droppable)
                    self._waiting_droppable -= 1
                    self._lost[type(dropped)] += 1
                self._waiting_droppable += 1
            self._queue.append(message)
            self._changed.notify()

    def _drop_first(self, *kinds: type) -> object | None:
        for position, message in enumerate(self._queue):
            if isinstance(message, kinds):
                del self._queue[position]
                return message
        return None

    def close(self, timeout_s: float = 1.0) -> None:
        """Send the waiting messages, for at most ``timeout_s``, and end the thread."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            # The other process does not read, so the send blocks; only this unblocks it.
            self._sock.shutdown(socket.SHUT_RDWR)
            self._thread.join(timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._queue:
                    if self._closing:
                        return
                    self._changed.wait()
                message = self._queue.popleft()
                if isinstance(message, self._droppable):
                    self._waiting_droppable -= 1
            try:
                self._sock.sendall(_encode_or_refuse(message))
            except OSError:
                with self._changed:
                    self._broken = True
                    self._queue.clear()
                return
