"""Rate at which one client is sent something new: halved, and halved again, while it lags.

A stream paced only by the client's acknowledgements fills a slow network, and everything else on
that path queues behind it: the other streams, and commands to a robot. So a client that
acknowledges late has its rate halved, up to three times, and gets it back step by step.
"""

from __future__ import annotations

from collections.abc import Callable

# If the network keeps up and the page paints, an acknowledgement takes less than 0.1 s.
_LATE_S = 0.4
# One late acknowledgement may come from a page that was busy for a moment.
_LATE_IN_A_ROW = 3
_MOST_HALVINGS = 3
# One step back up after this long without a late acknowledgement.
_RECOVERS_S = 1.0
# Of each new gap between two sends in their moving average.
_WEIGHT = 0.3
# A longer gap was a pause, and counts as this.
_LONGEST_GAP_S = 1.0


class Budget:
    """Budget of one client's stream.

    Args:
        clock: monotonic seconds.

    Attributes:
        halvings: how often the client's own rate is halved at present.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.halvings = 0
        self._interval_s: float | None = None
        self._sent: float | None = None
        self._late = 0
        self._good_since: float | None = None

    @property
    def wait_s(self) -> float:
        """Return the time until the next one may be sent."""
        if self.halvings == 0 or self._sent is None or self._interval_s is None:
            return 0.0
        due = self._sent + self._interval_s * 2.0**self.halvings
        return max(0.0, due - self._clock())

    def sent(self) -> None:
        """Note that one is sent now."""
        now = self._clock()
        if self._sent is not None and self.halvings == 0:
            # The client's own rate: as often as there is something new and it has acknowledged.
            gap = min(now - self._sent, _LONGEST_GAP_S)
            before = gap if self._interval_s is None else self._interval_s
            self._interval_s = before + _WEIGHT * (gap - before)
        self._sent = now

    def acknowledged(self, delay_s: float) -> None:
        """Note that an acknowledgement took this long, or was given up after it."""
        now = self._clock()
        if delay_s > _LATE_S:
            self._good_since = None
            self._late += 1
            if self._late >= _LATE_IN_A_ROW and self.halvings < _MOST_HALVINGS:
                self.halvings += 1
                self._late = 0
            return
        self._late = 0
        if self._good_since is None:
            self._good_since = now
        elif now - self._good_since >= _RECOVERS_S and self.halvings > 0:
            self.halvings -= 1
            self._good_since = now
