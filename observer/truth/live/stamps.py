"""Conversion of a server's stamps, which may be ticks or jump, into increasing seconds.

Some servers stamp with the time of day, some with their own counters, Vicon's object stream with
the frame number. A server's clock may be set, or restart together with the server.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.truth.live.clock import lower_line, not_alone

# Long enough to distinguish seconds from other units and to see a new clock's quickest arrival.
_SECONDS_SPAN_S = 0.5
# Counters take longer: the slope must distinguish similar rates.
_TICKS_SPAN_S = 2.0
_FEWEST = 10
_MOST_HELD = 20_000
_SECONDS_WITHIN = 0.05
_WHOLE_HZ_WITHIN = 0.1
_HIGHEST_WHOLE_HZ = 2000
_COUNTER_HZ = (1e4, 1e5, 1e6, 1e7, 1e9)
# Seconds: nothing arrives before it was sent, so an arrival early by more than this means that the
# clock was set. Clocks drift by far less within ten seconds.
_EARLY_S = 0.02
# Seconds: a network may delay everything by more than the first, but hardly for as long as the
# second.
_LATE_S = 0.05
_LATE_FOR_S = 3.0
# Seconds: after a silence, what a network held back arrives at once. Whatever is later than the
# first, and steadily so for the second, comes from a clock that was set back meanwhile.
_HELD_BACK_S = 1.0
_STEADY_S = 0.3
# Seconds: stamps of several bodies, or of reordered datagrams, may be this much out of order.
_DISORDER_S = 0.25
# A clock was set if this many stamps in a row agree on it; fewer are just wrong. Arrivals with the
# same stamp, such as the bodies of one frame, count once.
_AGREEING = 5
_JUMP_STEPS = 20.0
_MEMORY_BINS = 10

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Timed(Generic[_Item]):
    """An item with its time.

    Attributes:
        time: seconds on the server's clock, jumps removed.
        received: host's monotonic clock, seconds.
    """

    time: float
    received: float
    item: _Item


class StampReader(Generic[_Item]):
    """Turns stamps into seconds; holds items back until it knows how, usually for half a second.

    Args:
        notice: called with the kind and one sentence about what was noticed.
        counts: the stamps are known to be counters, not seconds.
    """

    def __init__(self, notice: Callable[[str, str], None], *, counts: bool = False) -> None:
        self._notice = notice
        self._counts = counts
        self._held: deque[tuple[float, float, _Item]] = deque(maxlen=_MOST_HELD)
        self._unit: float | None = None
        self._shift = 0.0
        # For each second of arrivals: its number, and the smallest lateness by our own seconds.
        self._quickest: deque[tuple[int, float]] = deque(maxlen=_MEMORY_BINS)
        self._late_since: float | None = None
        self._least_late = 0.0
        self._last_received = -math.inf
        # Late arrivals after a silence, each with its lateness.
        self._belated: list[tuple[float, float, float, _Item]] = []
        # Consecutive arrivals whose stamps do not fit the clock, each with its lateness.
        self._strange: list[tuple[float, float, float, _Item]] = []
        # The last different stamps of these, each with its lateness.
        self._strange_lately: deque[tuple[float, float]] = deque(maxlen=_AGREEING)
        self._last_stamp: float | None = None
        self._stampless = False
        # Lateness assumed when arrival times stand in for stamps.
        self._standing = 0.0
        self._jumps = 0
        self._reached_anew = False

    def restart(self) -> None:
        """Prepare for a new connection, whose clock may be different."""
        self._forget()
        self._reached_anew = True

    def feed(self, stamp: float, received: float, item: _Item) -> list[Timed[_Item]]:
        """Return what is ready now, in order: nothing, this item, or all that was held back.

        Items that are alone in not fitting the clock are left out.
        """
        silence = received - self._last_received
        self._last_received = received
        if self._unit is None:
            return self._hold([(stamp, received, item)])
        if self._stampless:
            if self._last_stamp in (None, stamp):
                return [self._timed(stamp, received, item)]
            return self._anew("the server's timestamps advance again", [(stamp, received, item)])
        late = received - self._time(stamp, received)
        if self._fits(stamp, late):
            self._forget_strange()
            behind = late - self._least_usual
            # A clock set back by more than the silence, within the disorder, is as late as well.
            silent = silence > behind - _DISORDER_S - _LATE_S
            if behind > _HELD_BACK_S and (self._belated or silent):
                self._belated.append((late, stamp, received, item))
                return self._return_from_silence()
            ready = self._release_belated()
            jump = self._late_jump(received, late)
            if jump is not None:
                return [*ready, *self._anew(_jump_sentence(jump), [(stamp, received, item)])]
            return [*ready, self._timed(stamp, received, item)]
        self._strange.append((late, stamp, received, item))
        if not self._strange_lately or self._strange_lately[-1][0] != stamp:
            self._strange_lately.append((stamp, late))
        if not self._is_set():
            return []
        jump = self._least_usual - late
        return self._anew(_jump_sentence(jump), [each[1:] for each in self._strange])

    def _anew(self, sentence: str, items: list[tuple[float, float, _Item]]) -> list[Timed[_Item]]:
        """Start with another clock, from the items that revealed it."""
        self._jumps += 1
        times = f" (jump number {self._jumps})" if self._jumps > 1 else ""
        self._notice("clock", sentence + times)
        self._forget()
        return self._hold(items)

    def _hold(self, items: list[tuple[float, float, _Item]]) -> list[Timed[_Item]]:
        self._held.extend(items)
        return self._release() if self._decide() else []

    def _forget(self) -> None:
        self._held.clear()
        self._unit = None
        self._last_stamp = None
        self._late_since = None
        self._belated = []
        self._forget_strange()

    def _return_from_silence(self) -> list[Timed[_Item]]:
        """Hold late arrivals back until it shows whether the network or the clock made them so."""
        first, last = self._belated[0], self._belated[-1]
        if last[2] - first[2] < _STEADY_S:
            return []
        late = [each[0] for each in self._belated]
        # Half of what a queue delivers is later than this; a short stall delays fewer.
        if np.median(late) - min(late) >= _LATE_S / 2:
            return self._release_belated()
        jump = self._least_usual - min(late)
        return self._anew(_jump_sentence(jump), [each[1:] for each in self._belated])

    def _release_belated(self) -> list[Timed[_Item]]:
        belated, self._belated = self._belated, []
        return [self._timed(*each[1:]) for each in belated]

    def _forget_strange(self) -> None:
        self._strange.clear()
        self._strange_lately.clear()

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
            # The clock was set meanwhile: use only what follows the jump.
            for _ in range(int(jumps[-1]) + 1):
                self._held.popleft()
            return False
        if stamps[0] == stamps[-1]:
            if span < _TICKS_SPAN_S:
                return False
            if not self._stampless:
                self._notice(
                    "stamps", "the server's timestamps do not advance, so arrival times are used"
                )
            self._stampless, self._unit = True, 1.0
            self._standing = min((each[1] for each in self._quickest), default=0.0)
            return True
        self._stampless = False
        slope = _slope(stamps - stamps[0], received - received[0])
        if not self._counts and abs(slope - 1) < _SECONDS_WITHIN:
            self._unit = 1.0
            return True
        if span < _TICKS_SPAN_S or slope <= 0:
            return False
        self._unit = _nominal(slope)
        if not self._counts:
            self._notice(
                "stamps",
                f"the server's timestamps are ticks, {1 / self._unit:g} per second",
            )
        return True

    def _release(self) -> list[Timed[_Item]]:
        """Return the items held back; a new clock continues the previous one's time."""
        held = list(self._held)
        self._held.clear()
        if not self._stampless:
            late = np.array([received - stamp * (self._unit or 1.0) for stamp, received, _ in held])
            confirmed = not_alone(late)
            held = [each for each, right in zip(held, confirmed.tolist(), strict=True) if right]
            if self._quickest:
                self._continue_at(float(late[confirmed].min()))
        self._reached_anew = False
        return [self._timed(*each) for each in held]

    def _continue_at(self, least: float) -> None:
        """Continue with a clock whose quickest arrival has this lateness, without a shift."""
        usual = self._least_usual
        # The same clock as before, just reconnected, keeps its shift.
        if -_EARLY_S < least - self._shift - usual < _LATE_S:
            return
        if self._reached_anew:
            self._notice(
                "clock",
                "the server's clock was different after the connection was lost; it is continued "
                "from arrival times",
            )
        self._shift = least - usual
        self._quickest.clear()

    # --- jumps --------------------------------------------------------------------------------

    @property
    def _least_usual(self) -> float:
        """Lateness of the quickest arrival of the last seconds."""
        return min(each[1] for each in self._quickest)

    def _fits(self, stamp: float, late: float) -> bool:
        """True if a stamp fits the clock as known, rather than a changed one."""
        if self._strange and abs(late - self._strange[-1][0]) < abs(late - self._least_usual):
            return False
        back = 0.0 if self._last_stamp is None else self._last_stamp - stamp
        return late >= self._least_usual - _EARLY_S and back * (self._unit or 1.0) <= _DISORDER_S

    def _is_set(self) -> bool:
        """True if consecutive stamps agree on a new clock, or have not fitted for long."""
        lately = [late for _, late in self._strange_lately]
        alike = max(lately) - min(lately) < _LATE_S
        waited = self._strange[-1][2] - self._strange[0][2]
        return (len(lately) == _AGREEING and alike) or waited > _LATE_FOR_S

    def _late_jump(self, received: float, late: float) -> float | None:
        """Return by how much the clock was set back (negative) if all has been late for long."""
        usual = self._least_usual
        if late <= usual + _LATE_S:
            self._late_since = None
            return None
        if self._late_since is None:
            self._late_since, self._least_late = received, late
        self._least_late = min(self._least_late, late)
        return usual - self._least_late if received - self._late_since > _LATE_FOR_S else None


def _jump_sentence(seconds: float) -> str:
    where = "ahead" if seconds > 0 else "back"
    return (
        f"the server's clock jumped {where} by {abs(seconds):.3g} s; it is continued from arrival "
        "times"
    )


def _slope(stamps: Float64Array, received: Float64Array) -> float:
    """Return the seconds per stamp unit, robust to one wrong stamp."""
    half = len(stamps) // 2
    apart = stamps[half:] - stamps[: len(stamps) - half]
    waited = received[half:] - received[: len(stamps) - half]
    moved = apart != 0
    if not moved.any():
        return 0.0
    about = float(np.median(waited[moved] / apart[moved]))
    confirmed = not_alone(received - about * stamps)
    return lower_line(stamps[confirmed], received[confirmed])[1]


def _jumps(stamps: Float64Array) -> NDArray[np.intp]:
    """Return the steps at which a clock of unknown unit was set: those far above the mean.

    The mean is that of the steps between different stamps: all bodies of a frame have the same.
    """
    steps = np.abs(np.diff(stamps))
    moved = steps > 0
    if not moved.any():
        return np.flatnonzero(moved)
    return np.flatnonzero(steps > _JUMP_STEPS * steps[moved].mean())


def _nominal(slope: float) -> float:
    """Return the seconds per tick, from the nearest nominal rate if one is close."""
    rate = 1 / slope
    if round(rate) >= 1 and rate < _HIGHEST_WHOLE_HZ and abs(rate - round(rate)) < _WHOLE_HZ_WITHIN:
        return 1 / round(rate)
    for each in _COUNTER_HZ:
        if abs(rate / each - 1) < 1e-3:
            return 1 / each
    return slope
