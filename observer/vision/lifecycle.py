"""Life cycle of a track, the same for every method: tentative, confirmed, coasting, ended.

Each method decides which evidence confirms a track; the consequences are decided here. Track ids
follow the state: provisional while tentative, permanent once confirmed. At a frame without a known
pose, obstacles coast and have no world position.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import count

from observer.types import Obstacle, TrackState

# In place of an id: not part of any obstacle.
NO_OBSTACLE = -1
_FIRST_PROVISIONAL = NO_OBSTACLE - 1


def next_state(state: TrackState, *, seen: bool, confirmed: bool) -> TrackState:
    """Return the state of a track after a frame.

    Args:
        seen: whether it was seen in this frame. confirmed: whether its evidence is sufficient by
            now; ignored once the track has been confirmed.
    """
    if state is TrackState.TENTATIVE:
        return TrackState.CONFIRMED if seen and confirmed else state
    return TrackState.CONFIRMED if seen else TrackState.COASTING


def expired(state: TrackState, missed: float, *, coast: float, patience: float) -> bool:
    """Return whether a track ends.

    Args:
        missed: how long it has not been seen; all three in the same unit, seconds or frames.
        coast: how long a confirmed track is kept unseen. patience: how long a tentative one.
    """
    return missed > (patience if state is TrackState.TENTATIVE else coast)


class TrackIds:
    """Ids of tracks; false alarms of a moment do not use up permanent ids.

    Shared by all segments of an observer, so that none, not even a provisional one, is used twice.
    """

    def __init__(self, lasting: Iterator[int] | None = None) -> None:
        """``lasting`` supplies the positive ids of confirmed tracks; from 1 if left out."""
        self._lasting = count(1) if lasting is None else lasting
        self._provisional = count(_FIRST_PROVISIONAL, -1)

    def provisional(self) -> int:
        """Return an id for a tentative track: below ``NO_OBSTACLE``."""
        return next(self._provisional)

    def confirmed(self, number: int) -> int:
        """Return the id of a confirmed track; a permanent id is kept."""
        return next(self._lasting) if is_provisional(number) else number


def is_provisional(number: int) -> bool:
    """Return whether this is the id of a track that was never confirmed."""
    return number <= _FIRST_PROVISIONAL


def without_pose(obstacle: Obstacle) -> Obstacle:
    """Return the obstacle without the values that require the camera's pose."""
    return replace(
        obstacle,
        position=None,
        velocity=None,
        position_cov=None,
        velocity_cov=None,
        orientation_wxyz=None,
        closing_speed=None,
    )


def while_lost(
    last: Iterable[tuple[Obstacle, float]], elapsed_s: float, coast_s: float
) -> tuple[Obstacle, ...]:
    """Return the obstacles that are reported while nothing can be measured.

    The camera is assumed to be where it was last, only to extrapolate in its own frame; obstacles
    unseen for longer than ``coast_s`` are left out.

    Args:
        last: each obstacle at the last frame whose pose is known, and the seconds for which it had
            not been seen by then.
        elapsed_s: seconds since that frame. coast_s: how long an obstacle is kept unseen.
    """
    return tuple(
        _unseen(obstacle, elapsed_s, missed_s + elapsed_s)
        for obstacle, missed_s in last
        if missed_s + elapsed_s <= coast_s
    )


def _unseen(obstacle: Obstacle, elapsed_s: float, missed_s: float) -> Obstacle:
    tentative = obstacle.state is TrackState.TENTATIVE
    why = obstacle.reason
    if obstacle.state is not TrackState.COASTING:
        why = out_of_sight(missed_s, f"before, {why}")
    return replace(
        without_pose(obstacle),
        state=TrackState.TENTATIVE if tentative else TrackState.COASTING,
        position_camera=obstacle.position_camera + elapsed_s * obstacle.velocity_camera,
        points=0,
        reason=why,
        silhouette=None,
    )


def out_of_sight(missed_s: float, known: str) -> str:
    """Explain a coasting obstacle: how long it was not seen, and what is known of it."""
    return f"not seen for {missed_s:.1f} s, position predicted; {known}"
