"""Reads a live source as the engine does, and records what came when."""

from __future__ import annotations

import time
from collections.abc import Callable

import psutil

from observer.sources.cameras.source import CameraSource
from observer.sources.contract import NoFrame
from observer.types import StereoFrame


class Watch:
    """Reads a source; records the frames, the troubles and the longest read.

    Attributes:
        frames: all received. troubles: (host's monotonic clock, sentence) at each change.
        longest_read_s: over all reads.
    """

    def __init__(self, source: CameraSource) -> None:
        self.source = source
        self.frames: list[StereoFrame] = []
        self.troubles: list[tuple[float, str]] = []
        self.longest_read_s = 0.0
        self._trouble: str | None = None

    def read(self) -> StereoFrame | NoFrame:
        before = time.monotonic()
        item = self.source.read()
        now = time.monotonic()
        self.longest_read_s = max(self.longest_read_s, now - before)
        if isinstance(item, StereoFrame):
            self.frames.append(item)
            self._trouble = None
        else:
            if item.trouble is not None and item.trouble != self._trouble:
                self.troubles.append((now, item.trouble))
            self._trouble = item.trouble or self._trouble
        return item

    def read_for(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.read()

    def read_until(self, reached: Callable[[], object], seconds: float = 8.0) -> None:
        end = time.monotonic() + seconds
        while not reached():
            assert time.monotonic() < end, f"not reached; last trouble: {self.troubles[-1:]}"
            self.read()

    def read_frames(self, count: int) -> None:
        """Read this many more frames."""
        wanted = len(self.frames) + count
        self.read_until(lambda: len(self.frames) >= wanted)

    def trouble_after(self, words: str) -> float:
        """Read until a trouble with these words; return the seconds from the last frame's reception
        to the first trouble after it."""
        start = len(self.troubles)
        self.read_until(lambda: any(words in said for _, said in self.troubles[start:]))
        last = self.frames[-1].received
        return next(when for when, _ in self.troubles[start:] if when > last) - last


def grabbers() -> list[psutil.Process]:
    """Return the camera processes of this process, including zombies."""
    found = []
    for child in psutil.Process().children(recursive=True):
        try:
            # A zombie has only a name; a video server reaps its own ffmpeg when it can.
            is_dead = child.status() == psutil.STATUS_ZOMBIE and child.name() != "ffmpeg"
            if is_dead or any(
                "observer.sources.cameras.grabber" in each for each in child.cmdline()
            ):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found
