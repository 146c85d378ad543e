"""Cache of frames in a worker, so that a source is not read again for every combination."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

from observer.camera import StereoCalibration
from observer.evaluation.sweep.sources import SweepSource
from observer.opening import OpenedSource, open_source
from observer.recording.payloads import Begins
from observer.sources.contract import (
    NoFrame,
    SegmentedSource,
    SkippedFrame,
    Source,
    SourceInfo,
)
from observer.truth.contract import Truth
from observer.types import StereoFrame

Kept = StereoFrame | SkippedFrame


class KeptSource:
    """Frames in memory as a source; fulfils ``Source``."""

    def __init__(
        self,
        info: SourceInfo,
        calibration: StereoCalibration | None,
        frames: Sequence[Kept],
        begins: Sequence[Begins | None],
    ) -> None:
        self.info, self.calibration, self._frames = info, calibration, frames
        self._begins = begins
        self._next = 0

    @property
    def begins(self) -> Begins | None:
        """Return what began with the frame read last, as in ``SegmentedSource``."""
        return self._begins[self._next - 1] if self._next else None

    def read(self) -> StereoFrame | SkippedFrame | NoFrame | None:
        """Return the next frame, None after the last one."""
        if self._next >= len(self._frames):
            return None
        self._next += 1
        return self._frames[self._next - 1]

    def rewind(self) -> None:
        """Go back to the first frame."""
        self._next = 0

    def close(self) -> None:
        """Do nothing: the frames stay in the cache."""


@dataclass(frozen=True, eq=False)
class _Entry:
    info: SourceInfo
    calibration: StereoCalibration | None
    frames: tuple[Kept, ...]
    begins: tuple[Begins | None, ...]
    truth: Truth | None
    size: int


class FrameCache:
    """Cache of the frames of the most recently used sources, for several threads.

    Args:
        most_bytes: limit for all images together. A source larger than that is read each time.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most = most_bytes
        self._kept: OrderedDict[tuple[str, int], _Entry] = OrderedDict()
        self._too_large: set[tuple[str, int]] = set()
        # Another thread that needs the same source waits rather than reading it again.
        self._lock = threading.Lock()

    def opened(self, source: SweepSource) -> OpenedSource:
        """Return the source at its first frame, to be closed by the caller.

        Raises:
            InputError: it cannot be opened.
        """
        key = (source.digest, source.frames)
        with self._lock:
            if key not in self._kept and key not in self._too_large:
                self._load(key, source)
            entry = self._kept.get(key)
            if entry is not None:
                self._kept.move_to_end(key)
        if entry is None:
            return open_source(source.benchmark.spec)
        kept = KeptSource(entry.info, entry.calibration, entry.frames, entry.begins)
        return OpenedSource(kept, entry.truth)

    def _load(self, key: tuple[str, int], source: SweepSource) -> None:
        opened = open_source(source.benchmark.spec)
        frames: list[Kept] = []
        begins: list[Begins | None] = []
        size = 0
        with closing(opened.source):
            while len(frames) < source.frames and (frame := _finite(opened.source)) is not None:
                frames.append(frame)
                read = opened.source
                begins.append(read.begins if isinstance(read, SegmentedSource) else None)
                if isinstance(frame, StereoFrame):
                    size += frame.left.nbytes + frame.right.nbytes
                if size > self._most:
                    self._too_large.add(key)
                    return
            entry = _Entry(
                opened.source.info,
                opened.source.calibration,
                tuple(frames),
                tuple(begins),
                opened.truth,
                size,
            )
        while self._kept and size + sum(e.size for e in self._kept.values()) > self._most:
            self._kept.popitem(last=False)
        self._kept[key] = entry


def _finite(source: Source) -> Kept | None:
    """Return the next frame, waiting for it: a finite source may have none at the moment."""
    while isinstance(frame := source.read(), NoFrame):
        time.sleep(0.01)
    return frame
