"""Images of recorded frames, one at a time, for a page to show beside the results."""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from app.server.errors import NotThere
from app.server.runs.archive import RunArchive
from observer.errors import DynamicObserverError, SourceError
from observer.image_files.jpeg import encode_jpeg
from observer.recording.reader import Recording
from observer.recording.run_folder import RECORDING
from observer.vision.rectification import Rectification

# Two runs side by side, for each of two users.
_MOST_OPEN = 4
# An open file of a deleted run keeps its disk space.
_IDLE_S = 60.0
_LOOK_S = 20.0
_JPEG_QUALITY = 85
# As for the live views: no part of the page shows more pixels.
_MAX_WIDTH = 1280


class FrameImages:
    """Left images of recorded frames; the recordings read last stay open for a while.

    Args:
        folder: returns a run's folder. clock: monotonic seconds.
    """

    def __init__(
        self, archive: RunArchive, folder: Callable[[str], Path], clock: Callable[[], float]
    ) -> None:
        self._archive = archive
        self._folder = folder
        self._clock = clock
        self._open: OrderedDict[tuple[object, ...], _Opened] = OrderedDict()
        self._lock = threading.Lock()

    async def jpeg(self, run_id: str, position: int) -> bytes:
        """Return the rectified left image of a frame, to which the obstacles' boxes refer.

        A re-run uses the images of the run that it re-ran.

        Args:
            position: position of the frame in the run, from 0.

        Raises:
            NotThere: there is no such run, no such frame, or no image of it.
            Conflict: its recording is being written.
        """
        own = self._folder(run_id) / RECORDING
        images = await self._archive.images(run_id)
        return await asyncio.to_thread(self._jpeg, own, images, position)

    async def keep_tidy(self) -> None:
        """Close recordings no longer read, until cancelled; then close all."""
        try:
            while True:
                await asyncio.sleep(_LOOK_S)
                await asyncio.to_thread(self._close_idle, self._clock() - _IDLE_S)
        finally:
            self._close_idle(None)

    def _jpeg(self, own: Path, images: Path, position: int) -> bytes:
        opened = self._opened(own, images)
        try:
            with opened.lock:
                return opened.jpeg(position)
        except DynamicObserverError as error:
            raise NotThere(str(error)) from error

    def _opened(self, own: Path, images: Path) -> _Opened:
        """Return the run's recording ``own`` and the one with its images, opened together."""
        try:
            stats = [each.stat() for each in (own, images)]
        except OSError as error:
            raise NotThere(f"{error.filename} cannot be read: {error.strerror}") from error
        key = own, images, *((each.st_size, each.st_mtime_ns) for each in stats)
        with self._lock:
            found = self._open.pop(key, None)
            if found is None:
                while len(self._open) >= _MOST_OPEN:
                    self._open.popitem(last=False)[1].close()
                found = _Opened(own, images)
            found.used_at = self._clock()
            self._open[key] = found
            return found

    def _close_idle(self, before: float | None) -> None:
        """Close the recordings not used since then; None closes all."""
        with self._lock:
            for key, opened in list(self._open.items()):
                if before is None or opened.used_at < before:
                    del self._open[key]
                    opened.close()


@dataclass
class _Opened:
    """Open recordings of one run.

    Attributes:
        own: recording that lists the run's frames. images: recording that holds their images.
        lock: held while reading. used_at: time of the last use, on the clock.
    """

    own: Path
    images: Path
    lock: threading.Lock = field(default_factory=threading.Lock)
    used_at: float = 0.0
    _files: ExitStack = field(default_factory=ExitStack)
    _closed: bool = False

    def jpeg(self, position: int) -> bytes:
        if self._closed:
            raise SourceError("the recording was closed meanwhile; ask again")
        frames = self._own.frames
        if not 0 <= position < len(frames):
            last = f"its frames are 0 to {len(frames) - 1}" if frames else "it has no frame"
            raise SourceError(f"there is no frame {position} in this run; {last}")
        frame = frames[position]
        if self.images != self.own:
            position = self._positions.get((frame.index, frame.time), -1)
        if position < 0:
            raise SourceError(f"the image of frame {frame.index} is not recorded")
        left = self._rectification.apply_left(self._pictured.left(position))
        return encode_jpeg(left, _JPEG_QUALITY, most_width=_MAX_WIDTH)

    def close(self) -> None:
        with self.lock:
            self._closed = True
            self._files.close()

    @cached_property
    def _own(self) -> Recording:
        return self._files.enter_context(Recording(self.own))

    @cached_property
    def _pictured(self) -> Recording:
        if self.images == self.own:
            return self._own
        return self._files.enter_context(Recording(self.images))

    @cached_property
    def _positions(self) -> dict[tuple[int, float], int]:
        """Positions of the frames with images, by frame number and time, which a re-run keeps."""
        return {(f.index, f.time): k for k, f in enumerate(self._pictured.frames)}

    @cached_property
    def _rectification(self) -> Rectification:
        return Rectification(self._own.calibration())
