"""Tests whether a camera's frames are fresh: neither queued up nor repeated."""

from __future__ import annotations

import math
import statistics
from collections import deque

import numpy as np

from observer.types import Image

_INTERVALS = 30
_SHORTEST_PERIOD_S = 1 / 240
_LONGEST_PERIOD_S = 1.0
# Assumed until intervals are measured, where the camera reports no rate.
_USUAL_PERIOD_S = 1 / 30


class Period:
    """Time from frame to frame: the median of the last intervals.

    Args:
        rate: frames per second as the camera reports them, used until measured.
    """

    def __init__(self, rate: float | None = None) -> None:
        self._nominal = _USUAL_PERIOD_S if not rate else 1.0 / rate
        self._intervals: deque[float] = deque(maxlen=_INTERVALS)
        self._last: float | None = None
        self._median: float | None = None

    def add(self, stamp: float) -> None:
        """Take the stamp of the next frame, seconds."""
        if self._last is not None and stamp > self._last:
            self._intervals.append(stamp - self._last)
            self._median = None
        self._last = stamp

    def interrupt(self) -> None:
        """Note that frames are missing between the last one and the next."""
        self._last = None

    @property
    def measured(self) -> bool:
        """Return whether enough intervals were seen."""
        return len(self._intervals) >= 8

    @property
    def settled(self) -> bool:
        """Return whether enough frames were seen that the stream's start no longer matters."""
        return len(self._intervals) == _INTERVALS or (self.measured and sum(self._intervals) >= 1.0)

    @property
    def seconds(self) -> float:
        """Seconds from frame to frame."""
        if not self.measured:
            return self._nominal
        if self._median is None:
            self._median = statistics.median(self._intervals)
        return min(max(self._median, _SHORTEST_PERIOD_S), _LONGEST_PERIOD_S)


class Backlog:
    """Separates frames that waited in a queue from those that came just now.

    After a stall, and at the start, a network delivers all queued frames at once, faster than a
    camera makes them. Only their pace shows this, so the first frame after a stall counts as old
    too. As many may be queued as the camera made during the stall, and a busy computer decodes them
    hardly faster than it makes others: they are old until as many have come, or until some come at
    at the camera's pace, because the network has lost the rest. A queue that drains no faster than
    that is noticed only where the stream has timestamps, by ``Lag``.

    Attributes:
        drains: whether the last frame was an old one that followed another one.
    """

    _LONGEST_S = 1.0
    # What may still be queued behind a frame that counts as new.
    _MOST_QUEUED_S = 0.1
    # Frames of which the mean interval tells the pace, and its share of the period.
    _PACED, _AT_PACE = 6, 0.9

    def __init__(self) -> None:
        self.drains = False
        self._last: float | None = None
        self._draining_since: float | None = None
        self._queued_s = 0.0
        self._arrivals: deque[float] = deque(maxlen=self._PACED)

    def holds(self, arrival: float, period: float) -> bool:
        """Return whether the frame that arrived at this moment is an old one.

        Args:
            arrival: host's monotonic clock, seconds.
            period: of the camera, seconds.
        """
        interval = None if self._last is None else arrival - self._last
        self._last, self.drains = arrival, False
        if interval is None or interval > 2.5 * period:
            self._draining_since = arrival
            self._queued_s = max(self._queued_s, 0.0) + (0.0 if interval is None else interval)
            self._arrivals.clear()
            self._arrivals.append(arrival)
            return True
        if self._draining_since is None:
            return False
        self._queued_s += interval - period
        self._arrivals.append(arrival)
        self.drains = not self._is_drained(interval, period, arrival - self._draining_since)
        if not self.drains:
            self._draining_since, self._queued_s = None, 0.0
        return self.drains

    def _is_drained(self, interval: float, period: float, passed_s: float) -> bool:
        arrivals = self._arrivals
        mean = (arrivals[-1] - arrivals[0]) / (self._PACED - 1)
        if len(arrivals) == self._PACED and mean >= self._AT_PACE * period:
            return True
        if self._queued_s > max(self._MOST_QUEUED_S, 2 * period):
            return False
        # A camera whose frames come in bursts is accepted after a while.
        return interval >= 0.5 * period or passed_s > self._LONGEST_S


class Lag:
    """Tells by a stream's own timestamps which frames waited in a queue.

    A frame's lag is its arrival minus its timestamp, compared with the least one of the last
    minute: so a queue is noticed however slowly it drains, at any pace. The clocks of cameras drift
    by less than 10 ms in that time.
    """

    _MOST_S = 0.1
    _MOST_PERIODS = 2.0
    # Seconds: the least lags are kept by so long a time each, and of so many such times.
    _TIME_S, _TIMES = 10.0, 6
    # A longer step between timestamps is another clock.
    _LONGEST_STEP_S = 30.0

    def __init__(self) -> None:
        self._sent: float | None = None
        # By begin of its time, host's clock.
        self._least: deque[tuple[float, float]] = deque(maxlen=self._TIMES)

    def holds(self, arrival: float, sent: float, period: float) -> bool:
        """Return whether the frame that arrived at this moment is an old one.

        Args:
            arrival: host's monotonic clock, seconds. sent: timestamp of the stream, seconds.
            period: of the camera, seconds.
        """
        if self._sent is None or not 0 < sent - self._sent <= self._LONGEST_STEP_S:
            self._least.clear()
        self._sent = sent
        lag = arrival - sent
        if not self._least or arrival - self._least[-1][0] > self._TIME_S:
            self._least.append((arrival, lag))
        elif lag < self._least[-1][1]:
            self._least[-1] = self._least[-1][0], lag
        late = lag - min(least for _, least in self._least)
        return late > max(self._MOST_S, self._MOST_PERIODS * period)


class Waiting:
    """Finds out by their stamps how long frames waited in the driver's queue.

    After a stall of its process, or while decoding takes longer than a period, a camera's driver
    delivers frames that it has queued. They count as received when they would have come without
    waiting, and those that waited long enough for a newer one to be there are skipped, which
    empties the queue.
    """

    # The queue that OpenCV asks for. A camera whose stamps are always late must still deliver, as
    # late as the stamps say.
    _MOST_SKIPPED = 4
    _WAITED_PERIODS = 1.5
    # A transfer takes a period at most; whatever takes longer makes a frame stale.
    _TRANSFER_S = 0.1
    _TRANSFER_PERIODS = 2.0

    def __init__(self) -> None:
        self._transfer_s = math.inf
        self._skipped = 0

    def add(self, arrival: float, stamp: float, period: float) -> tuple[float, bool]:
        """Return when the next frame would have come without waiting, and whether to skip it.

        Args:
            arrival: host's monotonic clock, seconds. stamp: of the exposure, same clock.
            period: of the camera, seconds.
        """
        self._transfer_s = min(self._transfer_s, arrival - stamp)
        longest = max(self._TRANSFER_S, self._TRANSFER_PERIODS * period)
        received = min(arrival, stamp + min(self._transfer_s, longest))
        if arrival - received <= self._WAITED_PERIODS * period:
            self._skipped = 0
            return received, False
        self._skipped += 1
        return received, self._skipped <= self._MOST_SKIPPED


class Repeats:
    """Counts how often an image was repeated bit for bit.

    Sensor noise makes every image different. Compares every fourth row. An image without contrast
    (covered lens, glaring light) may well repeat and is not counted: other checks detect that.
    """

    _ROWS = 4
    _CONTRAST = 8

    def __init__(self) -> None:
        self._last: Image | None = None
        self._count = 0

    def add(self, image: Image) -> int:
        """Return how many images before this one were the same."""
        rows = image[:: self._ROWS].copy()
        if (
            self._last is not None
            and np.array_equal(rows, self._last)
            and int(rows.max()) - int(rows.min()) >= self._CONTRAST
        ):
            self._count += 1
        else:
            self._count = 0
        self._last = rows
        return self._count
