"""Latest value of something large (an image, a cloud), passed through shared memory.

One process writes, any number read, and none of them waits. The memory is an anonymous file whose
descriptor is inherited, so nothing is left behind however a process ends.

Layout, in native 8 byte words::

    0 magic   1 capacity of one buffer, bytes   2 sequence published last (0: nothing yet)   3 -
    then twice: sequence (0 while it is written) | header bytes | payload bytes | CRC-32
    then the two buffers of ``capacity`` bytes, rounded up to words

A value goes into the buffer that was *not* published last, so a reader has until the next write but
one to copy it. Comparing the buffer's sequence before and after the copy reveals a read that was
overwritten (a seqlock); the CRC catches the cases that a weakly ordered processor could still let
through. A writer that dies halfway leaves the previously published value intact, and its successor
continues the sequence.
"""

from __future__ import annotations

import json
import mmap
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from typing_extensions import Buffer

from app.runtime.errors import ChannelError
from observer.processes import anonymous_memory

_MAGIC = int.from_bytes(b"latest01", "little")
_WORD = 8
_BUFFERS = 2
_FILE_WORDS = 4
_BUFFER_WORDS = 4
_DATA_START = (_FILE_WORDS + _BUFFERS * _BUFFER_WORDS) * _WORD
_PUBLISHED = 2
# A reader meets a half-written buffer only if two writes happen during one copy, which is rare
# several times in a row.
_READ_ATTEMPTS = 50


@dataclass(frozen=True, eq=False)
class Latest:
    """Value as it was written.

    Attributes:
        sequence: counted from 1 over the slot's life; a gap means that values were overwritten.
        header: small facts about the payload.
        payload: the bytes.
    """

    sequence: int
    header: dict[str, Any]
    payload: bytes


def create_slot(capacity: int) -> int:
    """Make a new empty slot for values of up to ``capacity`` bytes, header included.

    Memory is used only up to the size of the values actually written.

    Returns:
        The descriptor of an anonymous file. Pass it to other processes by inheritance
        (``pass_fds``) and close it where it is no longer needed.
    """
    if capacity < 1:
        raise ValueError(f"a slot's capacity must be at least 1 byte, not {capacity}")
    fd = anonymous_memory("latest value")
    capacity = -(-capacity // _WORD) * _WORD
    os.ftruncate(fd, _DATA_START + _BUFFERS * capacity)
    with mmap.mmap(fd, 0) as memory, memoryview(memory).cast("Q") as words:
        words[1] = capacity
        words[0] = _MAGIC
    return fd


class _Slot:
    """Mapped memory of a slot."""

    def __init__(self, fd: int) -> None:
        self._memory = mmap.mmap(fd, 0)
        self._bytes = memoryview(self._memory)
        self._words = self._bytes.cast("Q")
        if len(self._words) < _FILE_WORDS or self._words[0] != _MAGIC:
            self.close()
            raise ChannelError(f"descriptor {fd} is no latest-value slot")
        self.capacity = self._words[1]

    def close(self) -> None:
        """Unmap the memory; safe to call twice."""
        self._words.release()
        self._bytes.release()
        self._memory.close()


def _buffer_of(sequence: int, capacity: int) -> tuple[int, int]:
    """Return the index of the sequence's first descriptor word, and the start of its data."""
    buffer = sequence % _BUFFERS
    return _FILE_WORDS + buffer * _BUFFER_WORDS, _DATA_START + buffer * capacity


class LatestWriter(_Slot):
    """Writing side of a slot. Only one process may write at a time."""

    def write(self, header: Mapping[str, object], *payload: Buffer) -> int:
        """Publish a value, replacing the previous one; never waits for readers.

        Args:
            header: small facts, as JSON.
            payload: the bytes; several parts are concatenated.

        Returns:
            The value's sequence.

        Raises:
            ChannelError: header and payload exceed the slot's capacity; nothing was published.
        """
        head = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
        parts = [memoryview(part).cast("B") for part in payload]
        payload_size = sum(len(part) for part in parts)
        if len(head) + payload_size > self.capacity:
            raise ChannelError(
                f"a value of {len(head) + payload_size} bytes does not fit into a slot of "
                f"{self.capacity} bytes"
            )
        words = self._words
        # Read again each time: a predecessor that died may have written the slot.
        sequence = words[_PUBLISHED] + 1
        word, start = _buffer_of(sequence, self.capacity)
        words[word] = 0
        checksum = zlib.crc32(head, sequence & 0xFFFFFFFF)
        at = start
        for part in (memoryview(head), *parts):
            self._bytes[at : at + len(part)] = part
            at += len(part)
        for part in parts:
            checksum = zlib.crc32(part, checksum)
        words[word + 1] = len(head)
        words[word + 2] = payload_size
        words[word + 3] = checksum
        words[word] = sequence
        words[_PUBLISHED] = sequence
        return int(sequence)


class LatestReader(_Slot):
    """Reading side of a slot."""

    def read(self, after: int = 0) -> Latest | None:
        """Return the newest value if its sequence is above ``after``, complete or not at all.

        Return None if there is nothing newer, or if the writer was so fast that no complete value
        could be copied in a reasonable number of attempts.
        """
        for _ in range(_READ_ATTEMPTS):
            sequence = int(self._words[_PUBLISHED])
            if sequence <= after:
                return None
            value = self._copy(sequence)
            if value is not None:
                return value
        return None

    def _copy(self, sequence: int) -> Latest | None:
        words = self._words
        word, start = _buffer_of(sequence, self.capacity)
        if words[word] != sequence:
            return None
        head_size, payload_size, checksum = words[word + 1], words[word + 2], words[word + 3]
        if head_size + payload_size > self.capacity:
            return None
        head = bytes(self._bytes[start : start + head_size])
        payload = bytes(self._bytes[start + head_size : start + head_size + payload_size])
        if words[word] != sequence:
            return None
        if zlib.crc32(payload, zlib.crc32(head, sequence & 0xFFFFFFFF)) != checksum:
            return None
        return Latest(sequence, json.loads(head), payload)
