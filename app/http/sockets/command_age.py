"""How old a command is that came over the network, and whether the network can be driven over.

Pure: whoever calls tells the time. The client's clock stamps its messages; how it maps to the
host's is not told by anybody but bounded by what arrives. A message takes no negative time, so

    offset = host's clock - client's clock <= arrival - stamp        of every message, and
    offset >= ping sent - stamp of its answer                        of every answered ping.

The smallest ``arrival - stamp`` of the last seconds is the offset and the way of the quickest
message, which is taken for half the quickest round trip. Everything that delays a message after
its stamp (the page's own queue, the network, buffers in either kernel, this server's event loop)
makes it older, because arrival is when the application reads it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from app.contract.drive import COMMAND_FRESH_S

Quality = Literal["good", "slow", "lost"]

# Clocks drift by up to 1e-4: in so long by a millisecond.
_WINDOW_S = 10.0
# Clocks of pages are coarse, by up to 1 ms, and drift within the window.
_TOLERANCE_S = 0.005
# Of these the quickest round trip tells what the link can do now.
_LATELY_S = 2.0
# Pings are sent five times a second.
_LOST_S = 1.0
# For so long a command that came too late marks the link.
_LATE_SHOWN_S = 1.0
_MOST_PINGS = 64
TOO_SLOW = "stopped: link too slow"


@dataclass(frozen=True)
class LinkState:
    """How the link is.

    Attributes:
        quality: ``good``, ``slow`` (commands arrive too old to be driven by) or ``lost`` (nothing
            was answered lately).
        rtt_s: quickest round trip lately. delay_s: age of the newest command on arrival. None
            where not known.
    """

    quality: Quality
    rtt_s: float | None
    delay_s: float | None


class Link:
    """One client's link; times of the host in seconds, stamps of the client too."""

    def __init__(self) -> None:
        self._pings: dict[int, float] = {}
        # Each with the host's time at which it was learnt; oldest first.
        self._offsets: deque[tuple[float, float]] = deque()
        self._floors: deque[tuple[float, float]] = deque()
        self._trips: deque[tuple[float, float]] = deque()
        self._age: tuple[float, float] | None = None
        self._late = -math.inf

    def pinged(self, number: int, now: float) -> None:
        """A ping is about to be sent."""
        self._pings[number] = now
        while len(self._pings) > _MOST_PINGS:
            del self._pings[next(iter(self._pings))]

    def ponged(self, number: int, stamp: float, now: float) -> None:
        """A ping was answered; one that was never sent, or was answered before, says nothing."""
        sent = self._pings.pop(number, None)
        if sent is None or not math.isfinite(stamp) or self._is_ahead(stamp, now):
            return
        self._floors.append((now, sent - stamp))
        self._trips.append((now, now - sent))
        self._offsets.append((now, now - stamp))
        self._forget(now)

    def age(self, stamp: float, now: float) -> float | None:
        """How long ago a message that arrives now was stamped, seconds.

        None where that cannot be told: no ping was answered lately, or the stamp lies in the
        future.
        """
        self._forget(now)
        if not self._trips or not math.isfinite(stamp) or self._is_ahead(stamp, now):
            return None
        self._offsets.append((now, now - stamp))
        quickest = min(offset for _, offset in self._offsets)
        age = (now - stamp) - quickest + _smallest(self._trips) / 2
        self._age = (now, age)
        if age > COMMAND_FRESH_S:
            self._late = now
        return age

    def is_fit(self, now: float) -> bool:
        """Whether a command that arrives now can be fresh at all.

        Of a round trip that takes longer than a command lives nobody can say how much of it is
        the way here.
        """
        rtt = self._rtt(now)
        return rtt is not None and rtt <= COMMAND_FRESH_S and now - self._trips[-1][0] <= _LOST_S

    def state(self, now: float) -> LinkState:
        """How the link is."""
        rtt, delay = self._rtt(now), None
        if self._age is not None and now - self._age[0] <= _LATELY_S:
            delay = self._age[1]
        quality: Quality = "good"
        if not self._trips or now - self._trips[-1][0] > _LOST_S:
            quality = "lost"
        elif now - self._late <= _LATE_SHOWN_S or not self.is_fit(now):
            quality = "slow"
        return LinkState(quality, rtt, delay)

    def _rtt(self, now: float) -> float | None:
        self._forget(now)
        return min((trip for at, trip in self._trips if now - at <= _LATELY_S), default=None)

    def _is_ahead(self, stamp: float, now: float) -> bool:
        """Whether a stamp would have to be of the future, whatever the offset."""
        floor = max((floor for _, floor in self._floors), default=-math.inf)
        return now - stamp < floor - _TOLERANCE_S

    def _forget(self, now: float) -> None:
        for kept in (self._offsets, self._floors, self._trips):
            while kept and now - kept[0][0] > _WINDOW_S:
                kept.popleft()


def _smallest(kept: Iterable[tuple[float, float]]) -> float:
    return min(value for _, value in kept)
