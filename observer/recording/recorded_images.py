"""Images of a recording, each read from its chunk when it is asked for."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Sequence
from functools import cached_property
from typing import BinaryIO

from observer.errors import SourceError
from observer.recording import topics
from observer.recording.contents import (
    ChunkPlace,
    Contents,
    Message,
    chunk_records,
    message_entries,
    messages_of,
)
from observer.recording.images import jpeg_pixels, raw_pixels
from observer.types import Image

_SIDES = (topics.LEFT_RAW.name, topics.RIGHT_RAW.name)


class RecordedImages:
    """Images of a recording by their number; used by one thread.

    Args:
        file: the recording. contents: where it holds what. name: of the file, for messages.
    """

    def __init__(self, file: BinaryIO, contents: Contents, name: str) -> None:
        self._file = file
        self._contents = contents
        self._name = name
        # Offset and records of the chunk that was unpacked last.
        self._unpacked: tuple[int, bytes] | None = None

    @property
    def numbers(self) -> range:
        """Numbers of all pairs, with those that are lost between others."""
        return range(self._first, self._first + self._count)

    def left(self, number: int) -> Image:
        """Return a left image as it was taken; read-only if it is raw.

        Raises:
            SourceError: the recording holds no such image, or a damaged one.
        """
        return self._image(_SIDES[0], number)

    def right(self, number: int) -> Image:
        """Return a right image, as ``left`` does."""
        return self._image(_SIDES[1], number)

    def _image(self, side: str, number: int) -> Image:
        places = self._places[side]
        if not 0 <= number - self._first < self._count:
            raise SourceError(f"{self._name} has no images for this frame")
        message = self._numbered_message(places, number)
        schema = self._contents.schemas[self._contents.channels[message.channel].schema_id].name
        if schema == topics.LEFT_RAW.schema_name:
            return raw_pixels(message.data)
        return jpeg_pixels(message.data)

    def _numbered_message(self, places: Sequence[tuple[ChunkPlace, int]], number: int) -> Message:
        """Return the image of this number; where others are lost, it comes some places earlier."""
        # Places whose numbers are known to be lower, and higher.
        lower, higher = -1, len(places)
        k = number - self._first
        while lower + 1 < higher:
            k = min(max(k, lower + 1), higher - 1)
            message = self._message_at(*places[k])
            if message.sequence == number:
                return message
            if message.sequence < number:
                lower = k
            else:
                higher = k
            k += number - message.sequence
        raise SourceError(f"{self._name} is damaged: the images of this frame are lost")

    @cached_property
    def _places(self) -> dict[str, list[tuple[ChunkPlace, int]]]:
        found: dict[str, list[tuple[ChunkPlace, int]]] = {}
        for side in _SIDES:
            places = found[side] = []
            for channel in self._contents.channel_ids(side):
                for chunk in self._contents.chunks:
                    entries = message_entries(self._file, chunk, channel)
                    places += ((chunk, entry.offset) for entry in entries)
        return found

    @cached_property
    def _count(self) -> int:
        """Number of pairs, with those that are lost between others."""
        places = self._places[_SIDES[0]]
        if not places:
            return 0
        try:
            return self._message_at(*places[-1]).sequence + 1 - self._first
        except SourceError:
            return len(places)

    @cached_property
    def _first(self) -> int:
        # Not 0 in a saved clip, which begins in the middle of a run.
        for k, place in enumerate(self._places[_SIDES[0]]):
            with contextlib.suppress(SourceError):
                return self._message_at(*place).sequence - k
        return 0

    def _message_at(self, chunk: ChunkPlace, offset: int) -> Message:
        if self._unpacked is None or self._unpacked[0] != chunk.offset:
            self._unpacked = chunk.offset, chunk_records(self._file, chunk, self._name)
        try:
            return next(messages_of(self._unpacked[1], offset))
        except (StopIteration, struct.error):
            name = self._name
            raise SourceError(f"{name} is damaged: an image is not in its place") from None
