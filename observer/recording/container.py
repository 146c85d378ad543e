"""Writer of an MCAP file, chunk by chunk, that can be read at any time.

The ``mcap`` package's own writer can neither undo a chunk for which the disk had no space nor
resume an unfinished file. Here both work the same way: the file is truncated after its last
complete chunk, and further chunks or the file's end are written from there.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from observer.recording.contents import (
    CHUNK,
    COMPRESSION,
    MAGIC,
    MESSAGE,
    RECORD,
    Contents,
    Entry,
    chunk_index,
    find_contents,
)
from observer.recording.errors import RecordingError
from observer.recording.topics import Topic

LIBRARY = "dynamic-observer"
# LZ4's default level, and one that hardly searches: for camera images, which are noisy, it saves
# 3 % instead of 7 % but takes half the time to pack and to unpack.
_LEVEL, _BULK_LEVEL = 0, -10
# Size in bytes, before packing, at which a chunk is written immediately.
_LARGEST_CHUNK = 8 << 20
# Bytes: pieces from this size on are packed by a call of their own.
_LARGE_BYTES = 64 << 10


class _Chunk:
    """Messages of a chunk that is not written yet."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self.size = 0
        self.index: dict[int, list[Entry]] = {}

    def add(self, channel: int, sequence: int, log_time_ns: int, data: bytes) -> None:
        self.index.setdefault(channel, []).append(Entry(log_time_ns, self.size))
        head = RECORD.pack(Opcode.MESSAGE, MESSAGE.size + len(data))
        head += MESSAGE.pack(channel, sequence, log_time_ns, log_time_ns)
        self.pieces += (head, data)
        self.size += len(head) + len(data)


class Container:
    """Writes one MCAP file. Used by one thread.

    Args:
        file: open for writing bytes, positioned at its beginning; with ``resume`` also for
            reading. It is written piece by piece, so it needs no buffer of its own.
        name: of the file, for messages.
        resume: continue after the last complete chunk of the file.

    Attributes:
        size: of the complete part of the file, bytes. failure: the error after which nothing more
            is written, or None.

    Raises:
        RecordingError: the file cannot be written. From then on nothing is written, and every call
            that would write raises the same error.
        SourceError: there is nothing to resume.
    """

    def __init__(self, file: BinaryIO, name: str, *, resume: bool = False) -> None:
        self._file = file
        self._name = name
        self.failure: RecordingError | None = None
        self._finished = False
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[tuple[str, str], Channel] = {}
        self._counts: dict[int, int] = {}
        self._chunk_indexes = bytearray()
        self._chunk_count = 0
        self._span: tuple[int, int] | None = None
        self._plain, self._bulk = _Chunk(), _Chunk()
        self.size = 0
        if resume:
            self._resume(find_contents(file, name))
        else:
            self._write(MAGIC, _bytes_of(Header("", LIBRARY)))

    def add(self, topic: Topic, sequence: int, log_time_ns: int, data: bytes) -> None:
        """Add a message to the next chunk."""
        self._check()
        channel = self._channel(topic)
        chunk = self._bulk if topic.bulk else self._plain
        chunk.add(channel, sequence & 0xFFFFFFFF, log_time_ns, data)

    def write_large(self) -> None:
        """Write chunks that are large enough.

        ``add`` does not do so, so that messages that belong together, such as a frame's two
        images, share a chunk.
        """
        if self._bulk.size >= _LARGEST_CHUNK:
            self._bulk = self._written(self._bulk, _BULK_LEVEL)
        if self._plain.size >= _LARGEST_CHUNK:
            self.write_chunks()

    def write_chunks(self) -> None:
        """Write all pending messages."""
        self._check()
        # Images go first, so that every frame in the file has its images.
        self._bulk = self._written(self._bulk, _BULK_LEVEL)
        self._plain = self._written(self._plain, _LEVEL)

    def finish(self) -> None:
        """Write pending messages and the index; the file stays open. Safe to call twice."""
        if self._finished:
            return
        self.write_chunks()
        self._write(self._closing_records())
        self._finished = True

    # --- in the file -----------------------------------------------------------------------

    def _check(self) -> None:
        if self.failure is not None:
            raise self.failure

    def _write(self, *pieces: bytes) -> None:
        self._check()
        try:
            self._write_all(pieces)
        except OSError as error:
            self.failure = RecordingError.of(error, self._name)
            self._plain, self._bulk = _Chunk(), _Chunk()
            self._leave_whole()
            raise self.failure from None
        self.size += sum(map(len, pieces))

    def _write_all(self, pieces: tuple[bytes, ...]) -> None:
        for piece in pieces:
            view = memoryview(piece)
            while view:
                # An unbuffered file may write only a part, e.g. just before the disk is full.
                written = self._file.write(view)
                view = view[written:]

    def _leave_whole(self) -> None:
        """Cut off the incomplete chunk; the space it frees may suffice for the index."""
        with contextlib.suppress(OSError):
            self._cut()
            try:
                self._write_all((self._closing_records(),))
                self._finished = True
            except OSError:
                self._cut()

    def _cut(self) -> None:
        self._file.seek(self.size)
        self._file.truncate(self.size)

    def _channel(self, topic: Topic) -> int:
        known = self._channels.get((topic.name, topic.schema_name))
        if known is not None:
            return known.id
        schema = self._schemas.get(topic.schema_name)
        pieces = []
        if schema is None:
            schema = Schema(
                id=len(self._schemas) + 1,
                data=topic.schema(),
                encoding=topic.schema_encoding,
                name=topic.schema_name,
            )
            pieces.append(_bytes_of(schema))
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic.name,
            message_encoding=topic.encoding,
            metadata={},
            schema_id=schema.id,
        )
        # Written outside chunks, so that it can be read without unpacking any.
        self._write(*pieces, _bytes_of(channel))
        self._schemas[topic.schema_name] = schema
        self._channels[topic.name, topic.schema_name] = channel
        return channel.id

    def _written(self, chunk: _Chunk, level: int) -> _Chunk:
        if not chunk.pieces:
            return chunk
        packed, checksum = _packed(chunk.pieces, level)
        chunk.pieces.clear()
        packed_size = sum(map(len, packed))
        times = [entry.log_time_ns for entries in chunk.index.values() for entry in entries]
        name = len(COMPRESSION), COMPRESSION
        body = CHUNK.pack(min(times), max(times), chunk.size, checksum, *name, packed_size)
        head = RECORD.pack(Opcode.CHUNK, len(body) + packed_size) + body
        index = chunk_index(self.size, head)
        records = self._index_messages(index, chunk.index)
        self._write(head, *packed, records)
        self._remember(index)
        for id_, entries in chunk.index.items():
            self._counts[id_] = self._counts.get(id_, 0) + len(entries)
        return _Chunk()

    @staticmethod
    def _index_messages(index: ChunkIndex, entries: Mapping[int, Sequence[Entry]]) -> bytes:
        """Return the records that follow the chunk, and enter their offsets in its index."""
        records, begin = b"", index.chunk_start_offset + index.chunk_length
        for id_, found in entries.items():
            index.message_index_offsets[id_] = begin + len(records)
            records += _bytes_of(MessageIndex(channel_id=id_, records=list(found)))
        index.message_index_length = len(records)
        return records

    def _remember(self, index: ChunkIndex) -> None:
        # Kept as bytes, because a run of hours has very many of them.
        self._chunk_indexes += _bytes_of(index)
        self._chunk_count += 1
        start, end = self._span or (index.message_start_time, index.message_end_time)
        self._span = min(start, index.message_start_time), max(end, index.message_end_time)

    def _closing_records(self) -> bytes:
        end_of_data = _bytes_of(DataEnd(0))
        start, end = self._span or (0, 0)
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=end,
            message_start_time=start,
            metadata_count=0,
            schema_count=len(self._schemas),
        )
        groups = (
            (Opcode.SCHEMA, b"".join(map(_bytes_of, self._schemas.values()))),
            (Opcode.CHANNEL, b"".join(map(_bytes_of, self._channels.values()))),
            (Opcode.STATISTICS, _bytes_of(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes)),
        )
        summary_start = self.size + len(end_of_data)
        summary, offsets = b"", b""
        for opcode, records in groups:
            place = SummaryOffset(opcode, summary_start + len(summary), len(records))
            if records:
                offsets += _bytes_of(place)
            summary += records
        offsets_start = summary_start + len(summary)
        summary += offsets
        covered = summary + RECORD.pack(Opcode.FOOTER, 20)
        covered += struct.pack("<QQ", summary_start, offsets_start)
        footer = _bytes_of(Footer(summary_start, offsets_start, zlib.crc32(covered)))
        return end_of_data + summary + footer + MAGIC

    # --- going on ----------------------------------------------------------------------------

    def _resume(self, contents: Contents) -> None:
        self._schemas = {schema.name: schema for schema in contents.schemas.values()}
        self._channels = {
            (channel.topic, contents.schemas[channel.schema_id].name): channel
            for channel in contents.channels.values()
        }
        for chunk in contents.chunks:
            self.size = chunk.end
            if chunk.rebuilt is not None:
                self._cut()
                self._write(self._index_messages(chunk.index, chunk.rebuilt))
            self._remember(chunk.index)
        self._counts = dict(contents.counts)
        if not contents.chunks:
            self.size = contents.end
        self._cut()
        # Some may have come after the last complete chunk and been cut off; repeats are allowed.
        known = (*self._schemas.values(), *self._channels.values())
        self._write(*map(_bytes_of, known))


def _packed(pieces: Sequence[bytes], level: int) -> tuple[list[bytes], int]:
    """Return the pieces as one LZ4 frame, and the CRC of its content.

    Large pieces are packed one by one: joining megabytes of images would copy each again, and the
    memory traffic would also slow down the loop in the other thread. Small ones are joined, as a
    call for each message header would cost more than packing its bytes.
    """
    packer = lz4.frame.LZ4FrameCompressor(compression_level=level)
    packed, checksum = [packer.begin()], 0
    for piece in _gathered(pieces):
        packed.append(packer.compress(piece))
        checksum = zlib.crc32(piece, checksum)
    packed.append(packer.flush())
    return [piece for piece in packed if piece], checksum


def _gathered(pieces: Sequence[bytes]) -> Iterator[bytes]:
    """Yield the same bytes in fewer pieces, leaving large ones as they are."""
    small: list[bytes] = []
    for piece in pieces:
        if len(piece) < _LARGE_BYTES:
            small.append(piece)
            continue
        if small:
            yield b"".join(small)
            small.clear()
        yield piece
    if small:
        yield b"".join(small)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    end: Callable[[], bytes] = builder.end
    return end()
