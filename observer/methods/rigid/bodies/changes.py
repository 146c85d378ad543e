"""Instants at which something on one body, or at one place, looked different from before."""

from __future__ import annotations

from collections import deque

import numpy as np

# A body moves in place, as does what is at a place, if it changed in so many frames of these last
# seconds, in so many bursts with a pause between them, over at least that many seconds.
_WINDOW_S, _LEAST_FRAMES, _LEAST_BURSTS, _LEAST_SPAN_S = 3.0, 8, 3, 1.2
_PAUSE_S = 0.12


class Changes:
    """The instants of the last seconds at which something changed."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()

    def note(self, time: float, *, changed: bool) -> None:
        """Note whether something changed at a time, seconds, later than all before."""
        if changed and (not self._times or self._times[-1] < time):
            self._times.append(time)
        while self._times and self._times[0] < time - _WINDOW_S:
            self._times.popleft()

    def forget(self) -> None:
        """Forget all of it."""
        self._times.clear()

    @property
    def known(self) -> bool:
        """True if something changed in the last seconds."""
        return bool(self._times)

    @property
    def recurring(self) -> bool:
        """True if it changed often, again and again: something moves in place."""
        times = np.array(self._times)
        if len(times) < _LEAST_FRAMES or times[-1] - times[0] < _LEAST_SPAN_S:
            return False
        return bool(np.count_nonzero(np.diff(times) > _PAUSE_S) + 1 >= _LEAST_BURSTS)
