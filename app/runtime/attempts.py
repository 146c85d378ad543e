"""Failed attempts in a row to run a process, and the growing pause before the next one."""

from __future__ import annotations

import time

from app.runtime.supervisor_limits import SupervisorLimits

# Far beyond the longest pause; a number of failures without limit would overflow.
_MOST_DOUBLINGS = 60


class Attempts:
    """Attempts to run a process.

    Attributes:
        failed: number of failures in a row.
        not_before: host's monotonic clock, s: time of the next attempt.
    """

    def __init__(self, limits: SupervisorLimits) -> None:
        self._limits = limits
        self.failed = 0
        self.not_before = 0.0

    @property
    def exhausted(self) -> bool:
        """Return whether so many have failed that the start is given up."""
        return self.failed >= self._limits.attempts

    def count_failure(self, since: float) -> float:
        """Count the failure of a process that ran since ``since``.

        Returns:
            The pause before the next attempt, seconds, longer while processes keep ending quickly.
        """
        now = time.monotonic()
        self.failed = self.failed + 1 if now - since < self._limits.quick_death_s else 1
        pause = 0.0
        if self.failed > 1:
            doublings = min(self.failed - 2, _MOST_DOUBLINGS)
            pause = min(self._limits.backoff_s * 2.0**doublings, self._limits.most_backoff_s)
        self.not_before = now + pause
        return pause

    def lives(self, since: float) -> None:
        """Forget the failures once the process that has run since ``since`` has lived long."""
        if time.monotonic() - since >= self._limits.quick_death_s:
            self.failed = 0
