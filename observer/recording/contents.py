"""Index of an MCAP file, also of one whose end was never written.

The format: https://mcap.dev/spec. A file whose writer was killed ends anywhere; everything up to
the last whole chunk counts. Nothing is written here.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, MessageIndex, Schema, Statistics

from observer.errors import SourceError

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
# Start, end, uncompressed size and CRC-32, then the compression's name and the records.
CHUNK = struct.Struct("<QQQI")
COMPRESSION = b"lz4"
_FOOTER_BYTES = RECORD.size + 20 + len(MAGIC)
# A record that claims to be larger is no record.
_LARGEST = 1 << 32


class Entry(NamedTuple):
    """A message within a chunk: its log time, nanoseconds, and its offset in the records."""

    log_time_ns: int
    offset: int


class Message(NamedTuple):
    """A message as it was written."""

    channel: int
    sequence: int
    log_time_ns: int
    data: memoryview


@dataclass(frozen=True)
class ChunkPlace:
    """A whole chunk.

    Attributes:
        offset, length: of its record in the file, bytes. indexes: where the record of the
            ``MessageIndex`` of each channel in it begins. end: behind the last of those.
        rebuilt: the indexes themselves where those in the file may be cut off.
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int
    indexes: Mapping[int, int]
    end: int
    rebuilt: Mapping[int, tuple[Entry, ...]] | None = None

    def holds(self, channels: frozenset[int]) -> bool:
        """Tell whether it has a message of one of these channels."""
        return not channels.isdisjoint(self.indexes if self.rebuilt is None else self.rebuilt)


@dataclass(frozen=True)
class Contents:
    """Places of all that an MCAP file holds.

    Attributes:
        finished: the file has its end and its index.
        end: behind the last chunk and its indexes that are whole, bytes.
        counts: messages by channel, whole chunks only.
    """

    channels: Mapping[int, Channel]
    schemas: Mapping[int, Schema]
    chunks: tuple[ChunkPlace, ...]
    counts: Mapping[int, int]
    finished: bool
    end: int

    def channel_ids(self, *topics: str) -> frozenset[int]:
        """Return the ids of all channels of these topics."""
        return frozenset(id_ for id_, channel in self.channels.items() if channel.topic in topics)


def find_contents(file: BinaryIO, name: str) -> Contents:
    """Find all contents by the index, or chunk by chunk where there is none.

    Raises:
        SourceError: the file is no MCAP file.
    """
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise SourceError(f"{name} is no MCAP file; give a recording.mcap of a run")
    try:
        return _by_index(file) or _by_scanning(file)
    except (struct.error, ValueError, EOFError, McapError) as error:
        raise SourceError(f"{name} is damaged: {error}; give an undamaged recording") from None


def chunk_records(file: BinaryIO, chunk: ChunkPlace, name: str) -> bytes:
    """Return the records of a chunk, unpacked.

    Raises:
        SourceError: they are not those that were written.
    """
    file.seek(chunk.offset)
    records = _unpacked(file.read(chunk.length))
    if records is None:
        raise SourceError(
            f"{name} is damaged at byte {chunk.offset}: what was recorded there is lost"
        )
    return records


def messages_of(records: bytes, offset: int = 0) -> Iterator[Message]:
    """Yield the messages of a chunk's records, from the record at ``offset`` on."""
    for _, opcode, body in _records(records, offset):
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, _ = MESSAGE.unpack_from(body)
            yield Message(channel, sequence, log_time, body[MESSAGE.size :])


def message_entries(file: BinaryIO, chunk: ChunkPlace, channel: int) -> tuple[Entry, ...]:
    """Return the entries of one channel's messages in a chunk, in order."""
    if chunk.rebuilt is not None:
        return chunk.rebuilt.get(channel, ())
    place = chunk.indexes.get(channel)
    if place is None:
        return ()
    file.seek(place)
    _, length = RECORD.unpack(_exactly(file, RECORD.size))
    index = MessageIndex.read(ReadDataStream(io.BytesIO(_exactly(file, length))))
    return tuple(Entry(*record) for record in index.records)


def entries_of(records: bytes) -> dict[int, list[Entry]]:
    """Return the entries of each channel's messages in a chunk's records."""
    found: dict[int, list[Entry]] = {}
    for offset, opcode, body in _records(records):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = MESSAGE.unpack_from(body)
            found.setdefault(channel, []).append(Entry(log_time, offset))
    return found


def _unpacked(record: bytes) -> bytes | None:
    try:
        _, _, size, crc = CHUNK.unpack_from(record, RECORD.size)
        at = RECORD.size + CHUNK.size
        (name_length,) = struct.unpack_from("<I", record, at)
        compression = record[at + 4 : at + 4 + name_length]
        packed = memoryview(record)[at + 4 + name_length + 8 :]
        if compression != COMPRESSION:
            return None
        records = bytes(lz4.frame.decompress(packed))
    except (struct.error, RuntimeError, ValueError):
        return None
    return records if len(records) == size and zlib.crc32(records) == crc else None


def _by_index(file: BinaryIO) -> Contents | None:
    size = file.seek(0, os.SEEK_END)
    if size < _FOOTER_BYTES + len(MAGIC):
        return None
    file.seek(size - _FOOTER_BYTES)
    tail = file.read(_FOOTER_BYTES)
    opcode, length = RECORD.unpack_from(tail)
    if opcode != Opcode.FOOTER or length != 20 or not tail.endswith(MAGIC):
        return None
    footer = Footer.read(ReadDataStream(io.BytesIO(tail[RECORD.size :])))
    if not 0 < footer.summary_start < size - _FOOTER_BYTES:
        return None
    file.seek(footer.summary_start)
    summary = file.read(size - _FOOTER_BYTES - footer.summary_start)
    covered = summary + tail[: RECORD.size + 16]
    if footer.summary_crc and zlib.crc32(covered) != footer.summary_crc:
        return None
    channels, schemas, chunks = {}, {}, []
    counts: dict[int, int] = {}
    end = len(MAGIC)
    for _, opcode, body in _records(summary):
        stream = ReadDataStream(io.BytesIO(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
        elif opcode == Opcode.STATISTICS:
            counts = dict(Statistics.read(stream).channel_message_counts)
        elif opcode == Opcode.CHUNK_INDEX:
            index = ChunkIndex.read(stream)
            end = index.chunk_start_offset + index.chunk_length + index.message_index_length
            chunks.append(
                ChunkPlace(
                    index.chunk_start_offset,
                    index.chunk_length,
                    index.message_start_time,
                    index.message_end_time,
                    index.message_index_offsets,
                    end,
                )
            )
    return Contents(channels, schemas, tuple(chunks), counts, True, end)


def _by_scanning(file: BinaryIO) -> Contents:
    size = file.seek(0, os.SEEK_END)
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    chunks: list[ChunkPlace] = []
    at = end = len(MAGIC)
    while at + RECORD.size <= size:
        file.seek(at)
        opcode, length = RECORD.unpack(_exactly(file, RECORD.size))
        behind = at + RECORD.size + length
        if length > _LARGEST or behind > size or opcode in (Opcode.DATA_END, 0):
            break
        if opcode == Opcode.CHUNK:
            start, last, _, _ = CHUNK.unpack(_exactly(file, CHUNK.size))
            chunks.append(ChunkPlace(at, behind - at, start, last, {}, behind))
        elif opcode == Opcode.MESSAGE_INDEX and chunks:
            (channel,) = struct.unpack("<H", _exactly(file, 2))
            indexes = {**chunks[-1].indexes, channel: at}
            chunks[-1] = replace(chunks[-1], indexes=indexes, end=behind)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            stream = ReadDataStream(io.BytesIO(_exactly(file, length)))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                schemas[schema.id] = schema
            else:
                described = Channel.read(stream)
                channels[described.id] = described
        at = end = behind
    while chunks:
        # Behind the last chunk some of its indexes may be missing, or, after the machine itself
        # went down, the chunk may be empty space.
        last_chunk = chunks.pop()
        file.seek(last_chunk.offset)
        records = _unpacked(file.read(last_chunk.length))
        if records is not None:
            rebuilt = {id_: tuple(found) for id_, found in entries_of(records).items()}
            whole = last_chunk.offset + last_chunk.length
            chunks.append(replace(last_chunk, indexes={}, end=whole, rebuilt=rebuilt))
            break
        end = last_chunk.offset
    counts: dict[int, int] = {}
    for chunk in chunks:
        for id_ in chunk.indexes if chunk.rebuilt is None else chunk.rebuilt:
            counts[id_] = counts.get(id_, 0) + len(message_entries(file, chunk, id_))
    return Contents(channels, schemas, tuple(chunks), counts, False, end)


def _records(data: bytes, offset: int = 0) -> Iterator[tuple[int, int, memoryview]]:
    """Yield offset, opcode and body of each record, from the one at ``offset`` on."""
    view = memoryview(data)
    while offset + RECORD.size <= len(view):
        opcode, length = RECORD.unpack_from(view, offset)
        begin = offset + RECORD.size
        yield offset, opcode, view[begin : begin + length]
        offset = begin + length


def _exactly(file: BinaryIO, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise EOFError("it ends in the middle of a record")
    return data
