"""Index of an MCAP file, also of one whose end was never written.

The format: https://mcap.dev/spec. A file whose writer was killed may end anywhere; everything up
to the last complete chunk counts. This module writes nothing.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.records import Channel, ChunkIndex, MessageIndex, Schema

from observer.errors import SourceError

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
# Start, end, uncompressed size and CRC-32; length of the compression's name, that name, and size of
# the packed records, which follow.
CHUNK = struct.Struct("<QQQII3sQ")
COMPRESSION = b"lz4"
# Start of the summary, start of its offsets, and its CRC-32.
_FOOTER = struct.Struct("<QQI")
_FOOTER_BYTES = RECORD.size + _FOOTER.size + len(MAGIC)
# A record that claims to be larger than this is none.
_LARGEST = 1 << 32
_LARGEST_INDEX = 1 << 26


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
    """A complete chunk.

    Attributes:
        index: its place in the file, and that of the ``MessageIndex`` of each channel in it.
        rebuilt: the entries of each channel, if those in the file may be cut off.
    """

    index: ChunkIndex
    rebuilt: Mapping[int, Sequence[Entry]] | None = None

    @property
    def offset(self) -> int:
        """Offset of its record in the file, bytes."""
        return self.index.chunk_start_offset

    @property
    def end(self) -> int:
        """Offset of the end of its message indexes, bytes."""
        return self.offset + self.index.chunk_length + self.index.message_index_length

    @property
    def channels(self) -> Collection[int]:
        """Ids of the channels of its messages."""
        return self.index.message_index_offsets if self.rebuilt is None else self.rebuilt


@dataclass(frozen=True)
class Contents:
    """Places of everything in an MCAP file.

    Attributes:
        finished: the file has its end and its index.
        end: offset after the last complete chunk and its indexes, bytes.
        counts: messages by channel, complete chunks only.
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
    """Find all contents by the index, or chunk by chunk if there is none.

    Raises:
        SourceError: the file is not an MCAP file, or damaged.
    """
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise SourceError(f"{name} is not an MCAP file; give the recording.mcap of a run")
    try:
        return _by_index(file) or _by_scanning(file)
    except (struct.error, ValueError, EOFError, McapError) as error:
        raise SourceError(f"{name} is damaged: {error}; give an intact recording") from None


def chunk_records(file: BinaryIO, chunk: ChunkPlace, name: str) -> bytes:
    """Return the records of a chunk, unpacked.

    Raises:
        SourceError: they are damaged.
    """
    records = _unpacked(file, chunk)
    if records is None:
        raise SourceError(
            f"{name} is damaged at byte {chunk.offset}: the data recorded there is lost"
        )
    return records


def messages_of(records: bytes, offset: int = 0) -> Iterator[Message]:
    """Yield the messages of a chunk's records, from the record at ``offset`` on."""
    for _, opcode, body in _records(records, offset):
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, _ = MESSAGE.unpack_from(body)
            yield Message(channel, sequence, log_time, body[MESSAGE.size :])


def chunk_index(offset: int, head: bytes) -> ChunkIndex:
    """Return the index of a chunk without its messages.

    Args:
        offset: of its record in the file, bytes. head: the record up to the chunk's own records.
    """
    _, length = RECORD.unpack_from(head)
    start_ns, end_ns, size, _, _, _, packed_size = CHUNK.unpack_from(head, RECORD.size)
    return ChunkIndex(
        message_start_time=start_ns,
        message_end_time=end_ns,
        chunk_start_offset=offset,
        chunk_length=RECORD.size + length,
        message_index_offsets={},
        message_index_length=0,
        compression=COMPRESSION.decode(),
        compressed_size=packed_size,
        uncompressed_size=size,
    )


def message_entries(file: BinaryIO, chunk: ChunkPlace, channel: int) -> Sequence[Entry]:
    """Return the entries of one channel's messages in a chunk, in order.

    Where the index is damaged, they are found in the chunk itself; none if that is damaged too.
    """
    if chunk.rebuilt is not None:
        return chunk.rebuilt.get(channel, ())
    place = chunk.index.message_index_offsets.get(channel)
    if place is None:
        return ()
    try:
        return _indexed(file, place, channel)
    except (struct.error, ValueError, EOFError, McapError):
        records = _unpacked(file, chunk)
        return () if records is None else entries_of(records).get(channel, ())


def _indexed(file: BinaryIO, place: int, channel: int) -> Sequence[Entry]:
    file.seek(place)
    opcode, length = RECORD.unpack(_exactly(file, RECORD.size))
    if opcode != Opcode.MESSAGE_INDEX or length > _LARGEST_INDEX:
        raise ValueError("there is no message index")
    index = MessageIndex.read(ReadDataStream(io.BytesIO(_exactly(file, length))))
    if index.channel_id != channel:
        raise ValueError("the message index is that of another channel")
    return tuple(Entry(*record) for record in index.records)


def entries_of(records: bytes) -> dict[int, list[Entry]]:
    """Return the entries of each channel's messages in a chunk's records."""
    found: dict[int, list[Entry]] = {}
    for offset, opcode, body in _records(records):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = MESSAGE.unpack_from(body)
            found.setdefault(channel, []).append(Entry(log_time, offset))
    return found


def _unpacked(file: BinaryIO, chunk: ChunkPlace) -> bytes | None:
    file.seek(chunk.offset)
    record = file.read(chunk.index.chunk_length)
    try:
        _, _, size, crc, _, compression, _ = CHUNK.unpack_from(record, RECORD.size)
        if compression != COMPRESSION:
            return None
        packed = memoryview(record)[RECORD.size + CHUNK.size :]
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
    if RECORD.unpack_from(tail) != (Opcode.FOOTER, _FOOTER.size) or not tail.endswith(MAGIC):
        return None
    begin, _, crc = _FOOTER.unpack_from(tail, RECORD.size)
    if not 0 < begin < size - _FOOTER_BYTES:
        return None
    file.seek(begin)
    records = file.read(size - begin)
    # The CRC covers everything before itself.
    if crc and zlib.crc32(records[: -len(MAGIC) - 4]) != crc:
        return None
    # Not from the file itself, because the reader would close it.
    summary = NonSeekingReader(io.BytesIO(MAGIC + records)).get_summary()
    assert summary is not None
    chunks = tuple(map(ChunkPlace, summary.chunk_indexes))
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    end = chunks[-1].end if chunks else len(MAGIC)
    return Contents(summary.channels, summary.schemas, chunks, counts, True, end)


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
            file.seek(at)
            chunks.append(ChunkPlace(chunk_index(at, _exactly(file, RECORD.size + CHUNK.size))))
        elif opcode == Opcode.MESSAGE_INDEX and chunks:
            (channel,) = struct.unpack("<H", _exactly(file, 2))
            index = chunks[-1].index
            index.message_index_offsets[channel] = at
            index.message_index_length += behind - at
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
        # Some indexes of the last chunk may be missing, or, after a crash of the machine, the
        # chunk may be filled with zeros.
        last = chunks.pop()
        records = _unpacked(file, last)
        if records is not None:
            last.index.message_index_length = 0
            chunks.append(ChunkPlace(last.index, entries_of(records)))
            break
        end = last.offset
    counts: dict[int, int] = {}
    for chunk in chunks:
        for id_ in chunk.channels:
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
