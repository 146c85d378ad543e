"""Thread beside the loop that repeatedly aligns the observations with motion capture."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from app.engine.errors import unexpected
from app.workers.alignment.messages import Choices, Solve, Solved
from app.workers.alignment.process import AlignmentWorker
from observer.jsonl import ObservationLine
from observer.truth.alignment.live_clocks import LiveClocks, SourceClock
from observer.truth.alignment.online import pieces
from observer.truth.alignment.result import Alignment
from observer.truth.live.clock import ClockFit
from observer.truth.motion_capture import BodySample

_log = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.1
# The worker rests at least this long, and three times as long as it worked.
REST_S, _REST_SHARE = 2.0, 3.0
# One minute at 60 frames a second; a worker that takes longer is ended before that.
_MOST_WAITING = 3600
# Motion capture samples kept while nothing is observed.
_MOST_KEPT = 30_000
# Two alignments may differ by this much without contradicting each other.
_SIGMAS, _DELAYS_CHANGE_S = 3.0, 0.02
_LONGER = 1.5
NOTHING_SEEN = "not aligned yet: no frame has been observed"
_NO_SERVER_CLOCK = "not aligned yet: motion capture has only just started to send data"
_JUST_STARTED = "not aligned yet: the source has only just started"
_ANOTHER_CLOCK = (
    "not aligned yet: frames did not arrive in real time because the source paused or was too fast "
    "for this computer; alignment starts over"
)


class Aligns(Protocol):
    """Interface required of ``app.workers.alignment.process.AlignmentWorker``."""

    def solve(self, job: Solve) -> Solved | None: ...

    def end(self) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, eq=False)
class Aligned:
    """Current alignment.

    Attributes:
        session: the session that it applies to, as passed to ``begin``.
        clocks: the clock relation it was found with.
        carried: it was found before the source was reopened.
    """

    session: int
    alignment: Alignment
    clocks: LiveClocks
    carried: bool


class AlignmentThread(threading.Thread):
    """Alignment thread and its worker; starts itself.

    Attributes:
        aligned: the current alignment.
        sentence: the reason why there is none; begins with "not aligned yet".
    """

    def __init__(
        self,
        samples: Callable[[], list[BodySample]],
        server_clock: Callable[[], ClockFit | None],
        make_worker: Callable[[], Aligns] = AlignmentWorker,
        rest_s: float = REST_S,
    ) -> None:
        """Start the thread.

        Args:
            samples: returns the samples that arrived since the last call.
            server_clock: returns the fit of motion capture's clock, where known.
            rest_s: minimum pause between two solutions.
        """
        super().__init__(name="alignment", daemon=True)
        self.aligned: Aligned | None = None
        self.sentence = NOTHING_SEEN
        self._samples = samples
        self._server_clock = server_clock
        self._worker = make_worker()
        self._rest_s = rest_s
        # Calls to make in the thread: observation lines, and beginnings of sessions in between.
        self._waiting: deque[Callable[[], None]] = deque(maxlen=_MOST_WAITING)
        self._ending = threading.Event()
        # Used by the thread alone.
        self._session = 0
        self._choices = Choices()
        self._carried: Alignment | None = None
        self._source_clock = SourceClock()
        self._lines: list[dict[str, object]] = []
        self._kept: deque[BodySample] = deque(maxlen=_MOST_KEPT)
        self._anew = False
        self._slipped = False
        self._not_before = 0.0
        self.start()

    def begin(self, session: int, choices: Choices, *, carry: bool) -> None:
        """Begin a new session: another source, or the same one reopened.

        Args:
            carry: the clock relation and the camera's place on the robot are unchanged.
        """
        self._waiting.append(partial(self._begin, session, choices, carry=carry))

    def observed(self, line: ObservationLine, received: float) -> None:
        """Queue one frame's line with the time the frame was received."""
        self._waiting.append(partial(self._take, line, received))

    def end(self) -> None:
        """Stop aligning; returns at once."""
        self._ending.set()
        self._worker.end()

    # --- the thread --------------------------------------------------------------------------

    def run(self) -> None:
        """Align until ``end``."""
        try:
            while not self._ending.wait(_LOOK_EVERY_S):
                self._look()
        except Exception as error:  # noqa: BLE001
            # A failure here must not stop observing frames or driving robots.
            _log.exception("aligning failed")
            self.aligned = None
            self.sentence = f"not aligned yet: alignment failed: {unexpected(error)}"
        finally:
            self._worker.close()

    def _look(self) -> None:
        for _ in range(len(self._waiting)):
            self._waiting.popleft()()
        self._kept.extend(self._samples())
        server, source = self._server_clock(), self._source_clock.fit()
        if server is None or source is None:
            if self._lines and not self._slipped:
                self.sentence = _NO_SERVER_CLOCK if server is None else _JUST_STARTED
            return
        clocks = LiveClocks(server, source)
        if self._carried is not None:
            self._hold(self._carried, clocks, carried=True)
        if self._lines and time.monotonic() >= self._not_before:
            self._solve(clocks)

    def _begin(self, session: int, choices: Choices, *, carry: bool) -> None:
        before = self.aligned.alignment if self.aligned is not None else self._carried
        self._session, self._choices = session, choices
        self._carried = _carried(before) if carry and before is not None else None
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._source_clock = SourceClock()
        self._lines.clear()
        self._anew, self._slipped = True, False
        self.aligned, self.sentence = None, NOTHING_SEEN

    def _take(self, line: ObservationLine, received: float) -> None:
        seen = line["time"]
        if self._source_clock.add(seen, received):
            # The source stalled or restarted: the previous result no longer holds.
            self._carried = None
            self._begin_anew()
            self._source_clock.add(seen, received)
            self._slipped, self.sentence = True, _ANOTHER_CLOCK
        self._lines.append(_needed(line))

    def _hold(self, alignment: Alignment, clocks: LiveClocks, *, carried: bool) -> None:
        now = self.aligned
        if now is None or now.alignment is not alignment or now.clocks != clocks:
            self.aligned = Aligned(self._session, alignment, clocks, carried)

    def _solve(self, clocks: LiveClocks) -> None:
        samples = tuple(pieces(self._kept))
        job = Solve(self._anew, tuple(self._lines), samples, clocks, self._choices)
        self._lines.clear()
        self._kept.clear()
        self._anew = False
        solved = self._worker.solve(job)
        now = time.monotonic()
        if solved is None:
            self._not_before = now + self._rest_s
            return
        self._not_before = now + max(self._rest_s, _REST_SHARE * solved.seconds)
        if isinstance(solved.state, str):
            self.sentence = solved.state
            return
        known = None if self.aligned is None else self.aligned.alignment
        if known is None or _believable(solved.state, known):
            self._carried = None
            self._hold(solved.state, clocks, carried=False)


def _needed(line: ObservationLine) -> dict[str, object]:
    """Return the part of a line that the alignment needs."""
    return {
        "time": line["time"],
        "segment": line["segment"],
        "pose": line["pose"],
        "obstacles": [
            {
                "id": obstacle["id"],
                "state": obstacle["state"],
                "position": obstacle["position"],
                "velocity_time": obstacle["velocity_time"],
                "speed": obstacle["speed"],
                "speed_std": obstacle["speed_std"],
            }
            for obstacle in line["obstacles"]
        ],
    }


def _believable(found: Alignment, known: Alignment) -> bool:
    """Return true if the new alignment may replace the known one.

    Delays hardly change, so an alignment that contradicts the known delay needs a longer overlap: a
    few seconds of motion can fit at more than one offset.
    """
    apart = abs(found.time.offset_s - known.time.offset_s)
    within = _SIGMAS * math.hypot(found.time.sigma_s, known.time.sigma_s) + _DELAYS_CHANGE_S
    return apart <= within or found.time.overlap_s > _LONGER * known.time.overlap_s


def _carried(before: Alignment) -> Alignment | None:
    """Return what survives a reopening of the source: delays, roles and the camera's pose."""
    if before.observer is None or before.T_body_camera is None:
        # The pose of the new world cannot be determined.
        return None
    return replace(
        before,
        time=replace(before.time, drift_ppm=0.0, reference_s=0.0),
        segments=(),
        T_world_room={},
        matches={},
    )
