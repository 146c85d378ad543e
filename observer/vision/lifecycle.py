"""Life cycle of a track, the same for every method: tentative, confirmed, coasting, ended.

Which evidence confirms a track is the method's own; what follows from it is decided here. The
numbers of tracks follow it: provisional while tentative, lasting once confirmed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

from observer.types import TrackState

# -1 stands for no obstacle at all.
_FIRST_PROVISIONAL = -2


def next_state(state: TrackState, *, seen: bool, confirmed: bool) -> TrackState:
    """Return the state of a track after a frame.

    Args:
        seen: whether it was seen in this frame. confirmed: whether its evidence is enough by now;
            a track that was confirmed once needs no more of it.
    """
    if state is TrackState.TENTATIVE:
        return TrackState.CONFIRMED if seen and confirmed else state
    return TrackState.CONFIRMED if seen else TrackState.COASTING


def expired(state: TrackState, missed: float, *, coast: float, patience: float) -> bool:
    """Return whether a track ends.

    Args:
        missed: for how long it was not seen; all three in the same unit, seconds or frames.
        coast: how long a confirmed track is kept unseen. patience: a tentative one.
    """
    return missed > (patience if state is TrackState.TENTATIVE else coast)


class TrackIds:
    """Numbers of tracks; what seems to move for a moment uses up none that is shown."""

    def __init__(self, lasting: Iterator[int] | None = None) -> None:
        """``lasting`` gives each confirmed track its own, above zero; from 1 if left out."""
        self._lasting = count(1) if lasting is None else lasting
        self._provisional = count(_FIRST_PROVISIONAL, -1)

    def provisional(self) -> int:
        """Return a number for a tentative track: below zero, and below that of no obstacle."""
        return next(self._provisional)

    def confirmed(self, number: int) -> int:
        """Return the number of a confirmed track; one that has a lasting number keeps it."""
        return next(self._lasting) if is_provisional(number) else number


def is_provisional(number: int) -> bool:
    """Return whether this is the number of a track that was never confirmed."""
    return number <= _FIRST_PROVISIONAL
