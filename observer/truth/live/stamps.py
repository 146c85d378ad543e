"""Conversion of a server's stamps, which may be ticks or jump, into seconds that rise.

Some servers stamp with the time of day, some with counters of their own, Vicon's object stream
with the frame's number; and a server's clock may be set, or start again when it is restarted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.truth.live.clock import lower_line

# Long enough to tell seconds from anything else, and to see a new clock's quickest arrival.
_SECONDS_SPAN_S = 0.5
# Counters need a slope that tells one rate from the next.
_TICKS_SPAN_S = 2.0
_FEWEST = 10
_MOST_HELD = 20_000
_SECONDS_WITHIN = 0.05
_WHOLE_HZ_WITHIN = 0.1
_HIGHEST_WHOLE_HZ = 2000
_COUNTER_HZ = (1e4, 1e5, 1e6, 1e7, 1e9)
# Nothing arrives before it was sent: what seems to, by more than this, was stamped by a clock that
# was set. Clocks drift by far less within ten seconds.
_EARLY_S = 0.02
# A network may hold everything back for a while, but hardly for this long.
_LATE_S = 0.05
_LATE_FOR_S = 3.0
# Stamps of several bodies, or of datagrams that overtook each other, may be this much out of order.
_DISORDER_S = 0.25
_JUMP_STEPS = 20.0
_MEMORY_BINS = 10

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Timed(Generic[_Item]):
    """An item at its time.

    Attributes:
        time: seconds on the server's clock, without its jumps.
        received: host's monotonic clock, seconds.
    """

    time: float
    received: float
    item: _Item


class StampReader(Generic[_Item]):
    """Turns stamps into seconds; holds items back until it knows how, usually half a second.

    Args:
        notice: called with the kind and one sentence of what is noticed.
        counts: the stamps are known to be counters, not seconds.
    """

    def __init__(self, notice: Callable[[str, str], None], *, counts: bool = False) -> None:
        self._notice = notice
        self._counts = counts
        self._held: deque[tuple[float, float, _Item]] = deque(maxlen=_MOST_HELD)
        self._unit: float | None = None
        self._shift = 0.0
        # Of each second of arrivals the least that they came late, against our own seconds.
        self._quickest: deque[tuple[int, float]] = deque(maxlen=_MEMORY_BINS)
        self._late_since: float | None = None
        self._least_late = 0.0
        self._last_stamp: float | None = None
        self._stampless = False
        # Of arrivals that stand in for stamps: how late they count.
        self._standing = 0.0
        self._jumps = 0
        self._reached_anew = False

    def restart(self) -> None:
        """Prepare for a new connection, whose clock may be another."""
        self._forget()
        self._reached_anew = True

    def feed(self, stamp: float, received: float, item: _Item) -> list[Timed[_Item]]:
        """Return what is ready now, in order: nothing, this item, or all that was held back."""
        if self._unit is not None:
            jump = self._jumped(stamp, received)
            if jump is None:
                return [self._timed(stamp, received, item)]
            self._jumps += 1
            times = f" (jump number {self._jumps})" if self._jumps > 1 else ""
            self._notice("clock", jump + times)
            self._forget()
        self._held.append((stamp, received, item))
        return self._release() if self._decide() else []

    def _forget(self) -> None:
        self._held.clear()
        self._unit = None
        self._last_stamp = None

    def _timed(self, stamp: float, received: float, item: _Item) -> Timed[_Item]:
        time = self._time(stamp, received)
        self._last_stamp = stamp
        number, late = int(received), received - time
        if self._quickest and self._quickest[-1][0] == number:
            if late < self._quickest[-1][1]:
                self._quickest[-1] = (number, late)
        else:
            self._quickest.append((number, late))
        return Timed(time, received, item)

    def _time(self, stamp: float, received: float) -> float:
        if self._stampless:
            return received - self._standing
        return stamp * (self._unit or 1.0) + self._shift

    # --- what the stamps are ------------------------------------------------------------------

    def _decide(self) -> bool:
        first, last = self._held[0], self._held[-1]
        span = last[1] - first[1]
        if span < _SECONDS_SPAN_S or len(self._held) < _FEWEST:
            return False
        stamps = np.array([each[0] for each in self._held])
        received = np.array([each[1] for each in self._held])
        jumps = _jumps(stamps)
        if len(jumps):
            # The clock was set meanwhile: only what follows the jump counts.
            for _ in range(int(jumps[-1]) + 1):
                self._held.popleft()
            return False
        if stamps[0] == stamps[-1]:
            if span < _TICKS_SPAN_S:
                return False
            if not self._stampless:
                self._notice(
                    "stamps", "the server's stamps stand still, so arrivals are taken for them"
                )
            self._stampless, self._unit = True, 1.0
            self._standing = min((each[1] for each in self._quickest), default=0.0)
            return True
        self._stampless = False
        _, slope = lower_line(stamps - stamps[0], received - received[0])
        if not self._counts and abs(slope - 1) < _SECONDS_WITHIN:
            self._unit = 1.0
            return True
        if span < _TICKS_SPAN_S or slope <= 0:
            return False
        self._unit = _nominal(slope)
        if not self._counts:
            self._notice(
                "stamps",
                f"the server's stamps are no seconds but ticks, {1 / self._unit:g} a second",
            )
        return True

    def _release(self) -> list[Timed[_Item]]:
        """Return what was held back; a new clock continues where the one before it was."""
        if self._quickest and not self._stampless:
            unit = self._unit or 1.0
            least = min(each[1] - each[0] * unit for each in self._held)
            usual = min(each[1] for each in self._quickest)
            # The same clock as before, only reached anew, needs no second guess.
            if not -_EARLY_S < least - self._shift - usual < _LATE_S:
                if self._reached_anew:
                    self._notice(
                        "clock",
                        "after the connection was lost the server's clock was another; it is "
                        "taken on by arrival",
                    )
                self._shift = least - usual
                self._quickest.clear()
        self._reached_anew = False
        ready = [self._timed(*each) for each in self._held]
        self._held.clear()
        return ready

    # --- jumps --------------------------------------------------------------------------------

    def _jumped(self, stamp: float, received: float) -> str | None:
        """Return a sentence if the server's clock has changed."""
        if self._stampless:
            if self._last_stamp is not None and stamp != self._last_stamp:
                return "the server's stamps move again"
            self._last_stamp = stamp
            return None
        time = self._time(stamp, received)
        usual = min(each[1] for each in self._quickest)
        late = received - time
        if late < usual - _EARLY_S:
            return _jump_sentence(usual - late)
        if late > usual + _LATE_S:
            if self._late_since is None:
                self._late_since, self._least_late = received, late
            self._least_late = min(self._least_late, late)
            if received - self._late_since > _LATE_FOR_S:
                self._late_since = None
                return _jump_sentence(usual - self._least_late)
        else:
            self._late_since = None
        if self._last_stamp is not None and stamp < self._last_stamp:
            back = (self._last_stamp - stamp) * (self._unit or 1.0)
            if back > _DISORDER_S:
                return _jump_sentence(-back)
        return None


def _jump_sentence(seconds: float) -> str:
    where = "ahead" if seconds > 0 else "back"
    return (
        f"the server's clock jumped {where} by {abs(seconds):.3g} s and is taken on from there "
        f"by arrival"
    )


def _jumps(stamps: Float64Array) -> NDArray[np.intp]:
    """Return the steps at which a clock of unknown unit was set: those far beyond the mean."""
    steps = np.abs(np.diff(stamps))
    return np.flatnonzero(steps > _JUMP_STEPS * steps.mean())


def _nominal(slope: float) -> float:
    """Return the seconds in a tick, by the nominal rate where one is near."""
    rate = 1 / slope
    if round(rate) >= 1 and rate < _HIGHEST_WHOLE_HZ and abs(rate - round(rate)) < _WHOLE_HZ_WITHIN:
        return 1 / round(rate)
    for each in _COUNTER_HZ:
        if abs(rate / each - 1) < 1e-3:
            return 1 / each
    return slope
