"""The open source's time at instants of the host's clock, from when its frames were received."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

from app.contract.events import ObservationEvent
from observer.truth.alignment.live_clocks import SourceClock

# Without a frame for this many seconds and this many frame intervals, a source that is not live
# counts as standing still.
_GOES_ON_S, _GOES_ON_FRAMES = 0.3, 3.0
# Seconds of frames kept: robot reports are younger than this when they arrive.
_KEPT_S = 5.0


@dataclass(frozen=True)
class SourceInstant:
    """An instant on the source's clock.

    Attributes:
        time: seconds. segment: segment of the preceding frame. clock: number of the clock; times
            on different clocks cannot be compared.
    """

    time: float
    segment: int
    clock: int


class SourceTime:
    """Relates the host's clock to the open source's; used in the event loop.

    A frame that a busy machine received late changes nothing: the relation follows from the frames
    with the shortest delay.

    Attributes:
        live: the clock continues even if no frames arrive.
    """

    def __init__(self) -> None:
        self.live = False
        self._count = 0
        self.begin()

    def begin(self) -> None:
        """Begin another source, of which no frame is known yet."""
        self._count += 1
        self._clock = SourceClock()
        self._least_late: float | None = None
        # Reception time, source time and segment of the newest frames.
        self._frames: deque[tuple[float, float, int]] = deque()

    def observed(self, event: ObservationEvent) -> None:
        """Record a frame."""
        time, received = float(event.line["time"]), event.received
        if self._clock.add(time, received):
            self._count += 1
            self._least_late = None
            self._frames.clear()
        late = received - time
        self._least_late = late if self._least_late is None else min(late, self._least_late)
        self._frames.append((received, time, int(event.line["segment"])))
        while received - self._frames[0][0] > _KEPT_S:
            self._frames.popleft()

    def at(self, host: float) -> SourceInstant | None:
        """Return the source's time at an instant of the host's monotonic clock.

        Return None if the frames do not determine it: before the first one, and, unless the source
        is live, if none was received for some time before.
        """
        behind = bisect_right(self._frames, host, key=lambda frame: frame[0])
        if behind == 0 or self._least_late is None:
            return None
        received, time, segment = self._frames[behind - 1]
        step = time - self._frames[behind - 2][1] if behind > 1 else 0.0
        if not self.live and host - received > max(_GOES_ON_S, _GOES_ON_FRAMES * step):
            return None
        fit = self._clock.fit()
        at = host - self._least_late if fit is None else fit.to_server(host)
        return SourceInstant(at, segment, self._count)


class RisingTimes:
    """Filter that keeps the source times of robot reports strictly increasing for each role."""

    def __init__(self) -> None:
        self._last: dict[str, SourceInstant] = {}

    def of(self, role: str, instant: SourceInstant | None) -> SourceInstant | None:
        """Return the instant of a role's report; None if unknown or not later than the last."""
        last = self._last.get(role)
        if instant is None:
            return None
        if last is not None and last.clock == instant.clock and instant.time <= last.time:
            return None
        self._last[role] = instant
        return instant
