"""The numbers by which obstacles are told apart: provisional at first, lasting once confirmed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

# -1 stands for no obstacle at all.
_FIRST_PROVISIONAL = -2


class ObstacleNumbers:
    """Most of what seems to move for a moment is none; it must use up no number that is shown."""

    def __init__(self, lasting: Iterator[int] | None = None) -> None:
        """``lasting`` gives each confirmed obstacle its own, above zero; from 1 if left out."""
        self._lasting = count(1) if lasting is None else lasting
        self._provisional = count(_FIRST_PROVISIONAL, -1)

    def provisional(self) -> int:
        """Of an obstacle that is not confirmed yet: below zero, and below that of none."""
        return next(self._provisional)

    def confirmed(self, number: int) -> int:
        """The number of an obstacle that is confirmed; one that has a lasting one keeps it."""
        return next(self._lasting) if is_provisional(number) else number


def is_provisional(number: int) -> bool:
    """Whether this is the number of an obstacle that was not confirmed so far."""
    return number <= _FIRST_PROVISIONAL
