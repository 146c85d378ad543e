"""Age of a command that came over the network, and the fitness of the network for driving.

Pure: the caller passes the time. The client's clock stamps its messages. Nobody knows its offset to
the host's clock, but no ping is answered before it was sent, so

    offset = host's clock - client's clock >= ping sent - stamp of its answer.

The largest such bound of the last seconds gives the highest age that a message can have, whichever
direction of the link is the slow one. It exceeds the real age by the delay of the quickest ping on
its way to the client. Every delay of a message after its stamp (the page's own queue, the network,
buffers in either kernel, this server's event loop) makes it older, because arrival is when the
application reads it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from app.contract.drive import COMMAND_FRESH_S
from app.contract.sockets import LinkQuality

_WINDOW_S = 10.0
# Seconds per second by which two clocks drift apart at most: one millisecond in the window.
_DRIFT = 1e-4
# Page clocks have a resolution of up to 1 ms.
_TOLERANCE_S = 0.005
# The quickest round trip within this time shows what the link can do now.
_LATELY_S = 2.0
# Commands are sent ten times a second. One that takes longer expires before the next arrives, and a
# robot that stutters must not be shown with a good link.
_MOST_TRIP_S = COMMAND_FRESH_S - 0.1
# Pings are sent five times a second.
_LOST_S = 1.0
# Time for which a command that came too late marks the link as slow.
_LATE_SHOWN_S = 1.0
_MOST_PINGS = 64
TOO_SLOW = "stopped: connection too slow"


@dataclass(frozen=True)
class LinkState:
    """State of the link.

    Attributes:
        quality: ``good``, ``slow`` (commands arrive too old to drive by) or ``lost`` (no ping was
            answered lately).
        rtt_s: quickest recent round trip. delay_s: highest possible age of the newest command on
            arrival. None if unknown.
    """

    quality: LinkQuality
    rtt_s: float | None
    delay_s: float | None


class CommandAge:
    """Age of the commands of one client. Host times and client stamps are in seconds."""

    def __init__(self) -> None:
        self._pings: dict[int, float] = {}
        # Each with the host time at which it was measured; oldest first.
        self._floors: deque[tuple[float, float]] = deque()
        self._trips: deque[tuple[float, float]] = deque()
        self._age: tuple[float, float] | None = None
        self._late = -math.inf

    def pinged(self, number: int, now: float) -> None:
        """Note that a ping is about to be sent."""
        self._pings[number] = now
        while len(self._pings) > _MOST_PINGS:
            del self._pings[next(iter(self._pings))]

    def ponged(self, number: int, stamp: float, now: float) -> None:
        """Take the answer to a ping; ignore one that was never sent or was answered before."""
        sent = self._pings.pop(number, None)
        if sent is None or not math.isfinite(stamp) or self._is_ahead(stamp, now):
            return
        self._floors.append((now, sent - stamp))
        self._trips.append((now, now - sent))
        self._forget(now)

    def age(self, stamp: float, now: float) -> float | None:
        """Return the highest possible age of a message that arrives now, in seconds.

        It counts from the stamp. None if unknown: no ping was answered lately, or the stamp lies
        in the future.
        """
        self._forget(now)
        if not self._trips or not math.isfinite(stamp) or self._is_ahead(stamp, now):
            return None
        age = now - stamp - self._least_offset(now)
        self._age = (now, age)
        if age > COMMAND_FRESH_S:
            self._late = now
        return age

    def is_fit(self, now: float) -> bool:
        """Return whether commands that arrive now can be fresh until the next one arrives.

        The whole round trip counts, as nobody can tell how much of it was spent on the way here.
        """
        rtt = self._rtt(now)
        return rtt is not None and rtt <= _MOST_TRIP_S and now - self._trips[-1][0] <= _LOST_S

    def state(self, now: float) -> LinkState:
        """Return the state of the link."""
        rtt, delay = self._rtt(now), None
        if self._age is not None and now - self._age[0] <= _LATELY_S:
            delay = self._age[1]
        quality: LinkQuality = "good"
        if not self._trips or now - self._trips[-1][0] > _LOST_S:
            quality = "lost"
        elif now - self._late <= _LATE_SHOWN_S or not self.is_fit(now):
            quality = "slow"
        return LinkState(quality, rtt, delay)

    def _rtt(self, now: float) -> float | None:
        self._forget(now)
        return min((trip for at, trip in self._trips if now - at <= _LATELY_S), default=None)

    def _is_ahead(self, stamp: float, now: float) -> bool:
        """Return whether the stamp would lie in the future for any possible offset."""
        return now - stamp < self._least_offset(now) - _TOLERANCE_S

    def _least_offset(self, now: float) -> float:
        """Return the smallest offset of the clocks that agrees with all answered pings."""
        return max((floor - _DRIFT * (now - at) for at, floor in self._floors), default=-math.inf)

    def _forget(self, now: float) -> None:
        for kept in (self._floors, self._trips):
            while kept and now - kept[0][0] > _WINDOW_S:
                kept.popleft()
