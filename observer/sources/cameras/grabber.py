"""Process of one camera: ``python -m observer.sources.cameras.grabber``.

A native read that never returns can only be ended with its process, and decoding here keeps the
load off the observer's interpreter. The process grabs each frame and reports when; the source
decides whether it is decoded. Nothing is queued: a frame without a decision gives way to the next.
"""

from __future__ import annotations

import mmap
import os
import pkgutil
import select
import signal
import sys
import threading
import time

import cv2
import numpy as np

from observer.errors import SourceError
from observer.processes import die_with_parent
from observer.sources.cameras.capture import Capture, Opener
from observer.sources.cameras.freshness import Backlog, Lag, Period, Repeats, Waiting
from observer.sources.cameras.messages import (
    Behind,
    Command,
    Decode,
    Drop,
    Failed,
    Grabbed,
    Missed,
    Notice,
    Open,
    Opened,
    Ready,
    Resized,
    Undecodable,
    decode_command,
    encode,
)
from observer.sources.cameras.settings import AppliedSettings
from observer.types import Image

_FIRST_IMAGE_S = 10.0
# Longer than any timeout of the source.
_LONGEST_CALL_S = 15.0
# Share of a period that a frame waits for its decision, so that no queue builds up.
_WAITING = 0.9
# A camera that is gone fails at once, again and again; a timeout takes longer.
_AT_ONCE_S = 0.005
_ENDED_AFTER = 5
_BETWEEN_TRIES_S = 0.004
# Far more than the largest images need. FFmpeg buffers a whole part of an HTTP stream, up to 2 GB,
# whatever length the part declares.
_MOST_MEMORY_BYTES = 1 << 30


class Commands:
    """Receives in a thread of its own, to notice the end of the source even while a grab hangs.

    Args:
        fd: the pipe's end; its end of file ends this process.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._arrived = threading.Condition()
        self._latest: Command | None = None
        threading.Thread(target=self._receive, name="command receiver", daemon=True).start()

    def _receive(self) -> None:
        rest = b""
        while data := os.read(self._fd, 65536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                with self._arrived:
                    self._latest = decode_command(line)
                    self._arrived.notify()
        # The kernel then releases the device, even if a call hangs in it.
        os._exit(0)

    def wait(self, timeout: float | None) -> Command | None:
        """Return the newest command; None if none comes within ``timeout`` seconds."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._latest is not None, timeout)
            command, self._latest = self._latest, None
            return command


class Notices:
    """Pipe to the source."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        os.set_blocking(fd, False)

    def offer(self, notice: Notice) -> None:
        """Send the notice; drop it if the pipe is full, as it would be out of date later."""
        try:
            os.write(self._fd, encode(notice))
        except BlockingIOError:
            return

    def tell(self, notice: Notice) -> None:
        """Send the notice without fail; wait while the pipe is full."""
        data = encode(notice)
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                select.select([], [self._fd], [])


class Grabber:
    """Serves one opened camera until it fails.

    Args:
        capture: the camera. memory_fd: an empty shared memory, resized to hold one image.
    """

    def __init__(
        self, capture: Capture, commands: Commands, notices: Notices, memory_fd: int
    ) -> None:
        self._capture = capture
        self._commands = commands
        self._notices = notices
        self._memory_fd = memory_fd
        self._repeats = Repeats()
        self._in_vain = 0

    def run(self) -> None:
        """Deliver until the camera fails, which is reported."""
        first = self._first_image()
        if first is None:
            return
        image, applied = first
        shared = self._share(image.shape)
        self._repeats.add(image)
        height, width = image.shape[:2]
        channels = 1 if image.ndim == 2 else image.shape[2]
        rate = self._capture.rate
        self._notices.tell(
            Opened(width, height, channels, rate, dict(applied.accepted), applied.refused)
        )
        period = Period(rate)
        backlog, lag, waiting = Backlog(), Lag(), Waiting()
        seq = 0
        while self._next(period):
            arrival = time.monotonic()
            stamp = self._capture.stamp()
            exposed = arrival if stamp is None else stamp
            # A stamp gives a frame's age; without stamps only the pace shows it.
            received, is_old, held = arrival, False, False
            if stamp is None:
                held = backlog.holds(arrival, period.seconds)
                drains = backlog.drains
                sent = self._capture.sent()
                if sent is not None and lag.holds(arrival, sent, period.seconds):
                    held = drains = True
                    self._notices.offer(Behind())
                if drains:
                    # The pace of a queue is not the camera's.
                    period.interrupt()
            period.add(exposed)
            if stamp is not None:
                received, is_old = waiting.add(arrival, stamp, period.seconds)
            elif held:
                continue
            seq += 1
            # An old frame gives way at once, but the source learns of it, to count dropped pairs.
            until = arrival if is_old else arrival + _WAITING * period.seconds
            self._notices.offer(Grabbed(seq, exposed, arrival, received, until))
            if self._is_wanted(seq, until) and not self._deliver(seq, shared):
                return

    def _first_image(self) -> tuple[Image, AppliedSettings] | None:
        """Return the first image and the applied settings; None if no image comes."""
        applied = None
        deadline = time.monotonic() + _FIRST_IMAGE_S
        while time.monotonic() < deadline:
            if not self._next(None):
                return None
            # Only while it streams: many cameras forget earlier settings.
            if applied is None:
                applied = self._settle()
            image = self._capture.retrieve()
            if image is not None:
                return image, applied
            self._notices.offer(Undecodable())
        self._notices.tell(Failed("sends no images", alive=False))
        return None

    def _settle(self) -> AppliedSettings:
        try:
            return self._capture.settle()
        except SourceError as error:
            return AppliedSettings({}, (f"no settings could be applied: {error}",))

    def _next(self, period: Period | None) -> bool:
        """Wait for the next frame; False when the camera has failed, which was reported."""
        while True:
            began = time.monotonic()
            _be_ended_after(_LONGEST_CALL_S)
            if self._capture.grab():
                self._in_vain = 0
                return True
            if period is not None:
                period.interrupt()
            if time.monotonic() - began > _AT_ONCE_S:
                self._in_vain = 0
                self._notices.offer(Undecodable())
                continue
            self._in_vain += 1
            if self._in_vain >= _ENDED_AFTER:
                self._notices.tell(Failed("has stopped sending images", alive=False))
                return False
            time.sleep(_BETWEEN_TRIES_S)

    def _is_wanted(self, seq: int, until: float) -> bool:
        while (left := until - time.monotonic()) > 0:
            command = self._commands.wait(left)
            if isinstance(command, Decode | Drop):
                if command.seq == seq:
                    return isinstance(command, Decode)
                if isinstance(command, Decode):
                    self._notices.tell(Missed(command.seq))
        return False

    def _deliver(self, seq: int, shared: Image) -> bool:
        """Decode into the shared memory; False if the image has another size than before."""
        image = self._capture.retrieve()
        if image is None:
            self._notices.tell(Undecodable())
        elif image.shape != shared.shape:
            self._notices.tell(Resized(image.shape[1], image.shape[0]))
            return False
        else:
            shared[...] = image
            self._notices.tell(Ready(seq, self._repeats.add(image)))
        return True

    def _share(self, shape: tuple[int, ...]) -> Image:
        size = int(np.prod(shape))
        os.ftruncate(self._memory_fd, size)
        return np.frombuffer(mmap.mmap(self._memory_fd, size), np.uint8).reshape(shape)


def _be_ended_after(seconds: float) -> None:
    """Have the kernel end this process after so many seconds; 0 for never.

    The last resort for a native call that hangs and holds the GIL, so that the end of the source
    cannot be noticed.
    """
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _limit_memory() -> None:
    """Have the kernel refuse this process more memory than images need."""
    try:
        import resource
    except ImportError:  # There is no such module on Windows.
        return
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    if hard == resource.RLIM_INFINITY or hard > _MOST_MEMORY_BYTES:
        resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY_BYTES, hard))


def serve(commands: Commands, notices: Notices, memory_fd: int) -> None:
    """Open the camera on command, again on each command while that fails; then deliver."""
    while True:
        _be_ended_after(0.0)
        command = commands.wait(None)
        if not isinstance(command, Open):
            continue
        _be_ended_after(_LONGEST_CALL_S)
        try:
            opener: Opener = pkgutil.resolve_name(command.opener)
            capture = opener(command.address, command.settings)
        except SourceError as error:
            notices.tell(Failed(str(error), alive=True))
            continue
        Grabber(capture, commands, notices, memory_fd).run()
        return


def main() -> None:
    """Run with descriptors of commands, notices and memory, and a parent PID to die with, or 0."""
    commands_fd, notices_fd, memory_fd, parent_pid = map(int, sys.argv[1:5])
    # Ctrl-C in a terminal reaches all its processes; the source decides when this one ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if parent_pid:
        die_with_parent(parent_pid)
    _limit_memory()
    cv2.setNumThreads(1)
    notices = Notices(notices_fd)
    try:
        serve(Commands(commands_fd), notices, memory_fd)
    except Exception as error:  # noqa: BLE001 - whatever a driver raises is told by the source
        reason = f"failed in its driver ({type(error).__name__}) and is being reopened"
        notices.tell(Failed(reason, alive=False))
    # Skip the drivers' own clean-up, which may hang; the kernel releases everything.
    os._exit(1)


if __name__ == "__main__":
    main()
