"""Governor that reduces the processing of a live source if the computer is too slow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from observer.parameters.reductions import Reduction, reductions

# Seconds: each check covers at least this long, so that one slow frame changes nothing.
_LOOK_S: Final = 1.0
_LEAST_FRAMES: Final = 3
# Busy share of the time above which frames are dropped: the loop hardly ever waits for one.
_OVERLOADED: Final = 0.95
# Processing is restored one step if the busy share would then stay below this, for so many checks
# in a row.
_RELAXED: Final = 0.75
_RELAXED_LOOKS: Final = 5
# Overloaded checks before the first reduction: the frames after opening take longer.
_PATIENT_LOOKS: Final = 2


class RateGovernor:
    """Reduces processing one step at a time, and restores it once there is time to spare.

    It compares the time spent on frames with the total time passed, so it needs no frame rate: a
    camera's rate falls in the dark without any frame being dropped.
    """

    def __init__(self) -> None:
        self._level = 0
        self._looked: float | None = None
        self._busy_s = 0.0
        self._frames = 0
        self._overloaded = 0
        self._relaxed = 0

    def reduction(self, model: str) -> Reduction | None:
        """Return the active reduction; None for full processing.

        Args:
            model: the value of ``ego_motion.model``; not every method has reductions.
        """
        steps = reductions(model)
        level = min(self._level, len(steps))
        return None if level == 0 else steps[level - 1]

    def spent(self, began: float, ended: float, model: str) -> bool:
        """Record the time spent on one frame; return whether the reduction changed.

        Args:
            began, ended: seconds on one clock, later than those of the previous frame.
            model: as for ``reduction``.
        """
        if self._looked is None:
            self._looked = began
        self._busy_s += ended - began
        self._frames += 1
        passed = ended - self._looked
        if passed < _LOOK_S or self._frames < _LEAST_FRAMES:
            return False
        before = self.reduction(model)
        self._judge(self._busy_s / passed, reductions(model))
        self._looked, self._busy_s, self._frames = ended, 0.0, 0
        return self.reduction(model) != before

    def _judge(self, busy: float, steps: Sequence[Reduction]) -> None:
        self._level = level = min(self._level, len(steps))
        shares = (1.0, *(step.time_share for step in steps))
        restored = busy * shares[max(level - 1, 0)] / shares[level]
        self._overloaded = self._overloaded + 1 if busy > _OVERLOADED else 0
        self._relaxed = self._relaxed + 1 if restored < _RELAXED else 0
        if level < len(steps) and self._overloaded >= (1 if level else _PATIENT_LOOKS):
            self._level += 1
        elif level and self._relaxed >= _RELAXED_LOOKS:
            self._level -= 1
            self._relaxed = 0
