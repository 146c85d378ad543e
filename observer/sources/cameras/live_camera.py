"""One camera kept alive: its process, its faults and its reopening."""

from __future__ import annotations

import contextlib
import math
import subprocess
from collections import deque
from pathlib import Path
from typing import Literal

from observer.sources.cameras.freshness import Period
from observer.sources.cameras.messages import (
    Behind,
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
)
from observer.sources.cameras.process import GrabberProcess
from observer.sources.cameras.settings import CameraSettings
from observer.sources.cameras.spec import CameraTarget
from observer.sources.contract import CameraReport, CameraSide, CameraState
from observer.types import Image

# A fault is reported within 200 ms of the last frame; the rest allows for a late read.
_SILENCE_S = 0.16
_SILENT_PERIODS = 2.5
# A short network outage passes sooner than a stream can be reopened.
_REOPEN_AFTER_S = 1.0
_REOPEN_AFTER_PERIODS = 5.0
# Longer than the timeouts of drivers and FFmpeg at opening, which give a reason.
_OPENING_S = 12.0
# Shorter when reopening, as the opening time is then known: a damaged stream may never yield an
# image.
_REOPENING_S = 3.0
_REOPENING_TIMES = 3.0
_SHORTEST_PAUSE_S = 0.25
_LONGEST_PAUSE_S = 2.0
# Delay before a new process is started, which takes time: the fault is reported first.
_REPORTED_S = 0.05
# A camera that delivered for this long does not fail at every start, so its pause is not doubled.
_LASTED_S = 1.0
# Two equal images before this one: a noise-free image that repeats once is not a fault.
_FROZEN_REPEATS = 2

# Stamps kept to tell a frame that never had a partner from one whose partner was missed.
_RECENT = 4

_SILENT = "no longer sends images"
_UNDECODABLE = "sends images that cannot be decoded"
_BEHIND = (
    "falls behind because the network or this computer is too slow for its images; lower its "
    "resolution or frame rate"
)
_FROZEN = "sends the same image again and again"
_STAMPS_STAND = "sends images whose timestamps do not advance"
_UNPLUGGED = "is not connected; plug it in again"
_ABSENT = "is not connected; doctor lists the connected cameras"


class LiveCamera:
    """One camera, opened by the constructor and again after each fault. No call blocks.

    Args:
        side: of the image it delivers.
        opener: as in ``messages.Open``.
        now: host's monotonic clock, seconds, as in all methods.
    """

    def __init__(
        self,
        side: CameraSide,
        target: CameraTarget,
        settings: CameraSettings,
        opener: str,
        now: float,
    ) -> None:
        self.side = side
        self.target = target
        self._command = Open(target.address, settings, opener)
        self._process: GrabberProcess | None = None
        self._dying: list[subprocess.Popen[bytes]] = []
        self._state: Literal["starting", "delivering", "pausing"] = "pausing"
        self._since = now
        self._pause = 0.0
        self._opening_s = 0.0
        self._fault: str | None = None
        self._reported: str | None = None
        self._insists = False
        self._attended_since = now
        self._last_arrival = now
        self._undecodable_since: float | None = None
        # When the newest late image came.
        self._behind_at = -math.inf
        self._frozen_since: float | None = None
        self.repeats = False
        self._standing_stamps = 0
        self.period = Period()
        self.opened: Opened | None = None
        self.openings = 0
        self.failures = 0
        self.is_missing = False
        self._last_grabbed: Grabbed | None = None
        self.recent: deque[float] = deque(maxlen=_RECENT)
        self.pending: Grabbed | None = None
        self.decoding: Grabbed | None = None
        self.is_decoded = False
        self._start(now)

    @property
    def wakes(self) -> int | None:
        """Descriptor that becomes readable when the camera has something to report."""
        process = self._process
        return None if process is None or process.ended else process.notices

    @property
    def image(self) -> Image:
        """Last decoded image of an open camera: a view that changes with the next ``decode``."""
        assert self._process is not None
        return self._process.image

    @property
    def is_frozen(self) -> bool:
        """Return whether its images or its stamps no longer change."""
        return self._frozen_since is not None

    def attend(self, now: float) -> None:
        """Restart the time limits after a time without ``poll``: that is not the camera's fault."""
        self._attended_since = now

    def poll(self, now: float) -> None:
        """Take the notices of its process, and stop, wait or start it as due."""
        self._dying = [child for child in self._dying if child.poll() is None]
        if self._state == "pausing":
            if now >= self._since + self._pause:
                self._start(now)
            elif self._process is None and now >= self._since + _REPORTED_S:
                # Early, as its imports take as long as the pause; it opens nothing until commanded.
                with contextlib.suppress(OSError):
                    self._process = GrabberProcess()
        process = self._process
        if process is not None:
            for notice in process.receive():
                self._take(notice, now)
                if self._process is not process:
                    return
            if process.ended:
                self._fail("was lost because its process exited unexpectedly", now)
        self._watch(now)

    def decode(self) -> None:
        """Have the pending frame decoded; ``is_decoded`` tells when it is."""
        if self._process is not None and self.pending is not None:
            self._process.send(Decode(self.pending.seq))
            self.decoding, self.pending, self.is_decoded = self.pending, None, False

    def drop(self) -> None:
        """Drop the pending frame."""
        if self._process is not None and self.pending is not None:
            self._process.send(Drop(self.pending.seq))
            self.pending = None

    def release(self) -> None:
        """Release the decoded image, used or unwanted."""
        self.decoding, self.is_decoded = None, False

    def recovered(self) -> None:
        """Forget the last fault: the camera delivered."""
        self._fault = self._reported = None
        self._insists = False

    def trouble(self, now: float) -> str | None:
        """Return one sentence on what is wrong with it; None where nothing is."""
        fault = self._present_fault(now)
        self._reported = None if fault is None else f"{self} {fault}"
        return self._reported

    def report(self) -> CameraReport:
        """Return its state as of the last ``poll``; callable from any thread."""
        opened = self.opened
        settings = {} if opened is None else dict(opened.settings)
        if self.target.network and opened is not None and self.period.measured:
            settings["rate"] = f"{1 / self.period.seconds:.1f} per s, measured"
        stopped: CameraState = "failed" if self._insists else "waiting"
        return CameraReport(
            side=self.side,
            device=self.target.name,
            state="open" if self._state == "delivering" else stopped,
            trouble=self._reported,
            settings=settings,
            refused=() if opened is None else opened.refused,
        )

    def close(self) -> list[subprocess.Popen[bytes]]:
        """End its process; return the processes to wait for."""
        self._kill()
        self._state = "pausing"
        dying, self._dying = self._dying, []
        return dying

    def __str__(self) -> str:
        side = "" if self.side == "both" else f"{self.side} "
        return f"the {side}camera ({self.target.name})"

    def _present_fault(self, now: float) -> str | None:
        if self._state != "delivering":
            return self._fault or "is being opened"
        period = self.period.seconds
        silence = now - max(self._last_arrival, self._attended_since)
        most = max(_SILENCE_S, _SILENT_PERIODS * period)
        if silence > most:
            if self._undecodable_since is not None:
                return _UNDECODABLE
            return _BEHIND if now - self._behind_at <= most else _SILENT
        if self.decoding is not None and not self.is_decoded:
            # This frame came a period after the last good one, so the limit is a period shorter.
            waiting = now - max(self.decoding.arrival, self._attended_since)
            if waiting > max(_SILENCE_S - period, (_SILENT_PERIODS - 1.0) * period):
                return _SILENT
        if self._undecodable_since is not None:
            # The last good image was up to a period earlier.
            if now - self._undecodable_since > _SILENCE_S - period:
                return _UNDECODABLE
        elif self._frozen_since is not None:
            return _STAMPS_STAND if self._standing_stamps >= _FROZEN_REPEATS else _FROZEN
        return self._fault

    @property
    def _gone(self) -> str:
        return _UNPLUGGED if self.openings else _ABSENT

    def _start(self, now: float) -> None:
        if not self.target.network and not Path(self.target.address).exists():
            # Checking the name is cheap; a process is not.
            self._fault = self._gone
            self.is_missing = True
            self._since, self._pause = now, _SHORTEST_PAUSE_S
            return
        try:
            if self._process is None:
                self._process = GrabberProcess()
            self._process.send(self._command)
        except OSError as error:
            self._fail(
                f"cannot be opened: its process could not be started ({error.strerror})", now
            )
            return
        self._state, self._since = "starting", now
        self.is_missing = False

    def _fail(self, fault: str, now: float, *, alive: bool = False) -> None:
        if not self.target.network and not Path(self.target.address).exists():
            fault = self._gone
        lasted = self._state == "delivering" and now - self._since > _LASTED_S
        self._pause = min(
            _SHORTEST_PAUSE_S if lasted or not self._pause else 2 * self._pause, _LONGEST_PAUSE_S
        )
        self._state, self._since, self._fault = "pausing", now, fault
        self.failures += 1
        if not alive:
            self._kill()
        self.pending = None
        self.release()

    def _kill(self) -> None:
        if self._process is not None:
            self._dying.append(self._process.kill())
            self._process = None

    def _watch(self, now: float) -> None:
        if self._state == "starting" and now - self._since > self._patience_s():
            self._fail("does not answer; check that it is on and connected", now)
        elif self._state == "delivering":
            silent_since = max(self._last_arrival, self._attended_since)
            borne_s = max(_REOPEN_AFTER_S, _REOPEN_AFTER_PERIODS * self.period.seconds)
            for since in (silent_since, self._undecodable_since, self._frozen_since):
                if since is not None and now - max(since, self._since) > borne_s:
                    self._fail(self._present_fault(now) or _SILENT, now)
                    return
            if now - self._since > borne_s:
                # It is back, even if the other camera gives no partner image to prove it.
                self._fault = None

    def _patience_s(self) -> float:
        """Return how long it may take to open."""
        if not self.openings:
            return _OPENING_S
        return min(max(_REOPENING_S, _REOPENING_TIMES * self._opening_s), _OPENING_S)

    def _take(self, notice: Notice, now: float) -> None:
        match notice:
            case Opened():
                self._take_opened(notice, now)
            case Grabbed():
                self._take_grabbed(notice, now)
            case Ready(seq, repeats):
                self._undecodable_since = None
                self.repeats = repeats > 0
                if repeats >= _FROZEN_REPEATS and self._frozen_since is None:
                    self._frozen_since = now
                elif repeats == 0 and self._standing_stamps < _FROZEN_REPEATS:
                    self._frozen_since = None
                if self.decoding is not None and self.decoding.seq == seq:
                    self.is_decoded = True
            case Missed(seq):
                if self.decoding is not None and self.decoding.seq == seq:
                    self.release()
            case Undecodable():
                self._undecodable_since = self._undecodable_since or now
                self.release()
            case Behind():
                self._behind_at = now
            case Resized(width, height):
                had = "" if self.opened is None else f"{_size(self.opened)} to "
                self._fail(f"changed its images from {had}{width}x{height} pixels", now)
            case Failed(reason, alive):
                self._fail(reason, now, alive=alive)

    def _take_opened(self, opened: Opened, now: float) -> None:
        before = self.opened
        if before is not None and _shape(before) != _shape(opened):
            self._fail(
                f"now delivers {_size(opened)} pixels instead of {_size(before)}; change it back "
                "or reopen the source",
                now,
            )
            self._insists = True
            return
        assert self._process is not None
        self._process.map(opened)
        self._opening_s = max(self._opening_s, now - self._since)
        self.opened = opened
        self._insists = False
        self.openings += 1
        self.period = Period(opened.rate)
        self._undecodable_since = None
        self._standing_stamps = 0
        self._last_grabbed = None
        self.recent.clear()
        self._last_arrival = now
        self._state, self._since = "delivering", now

    def _take_grabbed(self, grabbed: Grabbed, now: float) -> None:
        last, self._last_grabbed = self._last_grabbed, grabbed
        self.recent.append(grabbed.stamp)
        if last is None or grabbed.seq != last.seq + 1:
            self.period.interrupt()
        self.period.add(grabbed.stamp)
        if last is not None and grabbed.stamp == last.stamp:
            self._standing_stamps += 1
            if self._standing_stamps >= _FROZEN_REPEATS and self._frozen_since is None:
                self._frozen_since = now
        elif self._standing_stamps:
            self._standing_stamps = 0
            self._frozen_since = None
        self._last_arrival = grabbed.arrival
        self.pending = grabbed


def _shape(opened: Opened) -> tuple[int, int, int]:
    return opened.height, opened.width, opened.channels


def _size(opened: Opened) -> str:
    return f"{opened.width}x{opened.height}"
