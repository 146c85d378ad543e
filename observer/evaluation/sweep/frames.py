"""Frames that a worker keeps, so that a source is not read anew for every combination."""

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
from observer.sources.contract import NoFrame, SkippedFrame, Source, SourceInfo
from observer.truth.contract import Truth
from observer.types import StereoFrame

Kept = StereoFrame | SkippedFrame


class KeptSource:
    """Frames in memory as a source; fulfils ``Source``."""

    def __init__(
        self, info: SourceInfo, calibration: StereoCalibration | None, frames: Sequence[Kept]
    ) -> None:
        self._info, self._calibration, self._frames = info, calibration, frames
        self._next = 0

    @property
    def info(self) -> SourceInfo:
        return self._info

    @property
    def calibration(self) -> StereoCalibration | None:
        return self._calibration

    def read(self) -> StereoFrame | SkippedFrame | NoFrame | None:
        """The next of the frames, None after the last one."""
        if self._next >= len(self._frames):
            return None
        self._next += 1
        return self._frames[self._next - 1]

    def rewind(self) -> None:
        """Go back to the first frame."""
        self._next = 0

    def close(self) -> None:
        """The frames stay where they are kept."""


@dataclass(frozen=True, eq=False)
class _Entry:
    info: SourceInfo
    calibration: StereoCalibration | None
    frames: tuple[Kept, ...]
    truth: Truth | None
    size: int


class FrameCache:
    """The frames of the sources that were used last; for several threads.

    Args:
        most_bytes: of all images together. A source larger than that is read each time.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most = most_bytes
        self._kept: OrderedDict[tuple[str, int], _Entry] = OrderedDict()
        self._too_large: set[tuple[str, int]] = set()
        # Whoever wants the same source meanwhile waits for it rather than reading it twice.
        self._lock = threading.Lock()

    def opened(self, source: SweepSource) -> OpenedSource:
        """The source from its first frame on, to be closed by the caller.

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
        return OpenedSource(KeptSource(entry.info, entry.calibration, entry.frames), entry.truth)

    def _load(self, key: tuple[str, int], source: SweepSource) -> None:
        opened = open_source(source.benchmark.spec)
        frames: list[Kept] = []
        size = 0
        with closing(opened.source):
            while len(frames) < source.frames and (frame := _finite(opened.source)) is not None:
                frames.append(frame)
                if isinstance(frame, StereoFrame):
                    size += frame.left.nbytes + frame.right.nbytes
                if size > self._most:
                    self._too_large.add(key)
                    return
            entry = _Entry(
                opened.source.info, opened.source.calibration, tuple(frames), opened.truth, size
            )
        while self._kept and size + sum(e.size for e in self._kept.values()) > self._most:
            self._kept.popitem(last=False)
        self._kept[key] = entry


def _finite(source: Source) -> Kept | None:
    """The next frame; a source with an end may still have none at this moment."""
    while isinstance(frame := source.read(), NoFrame):
        time.sleep(0.01)
    return frame
