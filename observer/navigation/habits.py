"""Habits of each person so far: going on, stopping or turning."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.guard.sight import SeenObstacle
from observer.navigation.futures import displaced

# Interval after which the predicted velocity is compared with the observed one.
_LOOK_S: Final = 0.4
# One standard deviation of the velocity after that time, in addition to the track's own.
_MANOEUVRE_MPS: Final = 0.25
# Nobody does the same forever: in each such interval the weights move this share towards the prior.
_FORGETTING: Final = 0.3
_FORGOTTEN_S: Final = 3.0


@dataclass(frozen=True)
class _Habit:
    """Velocity (2,) m/s of one track at its last comparison, its time, and the weights (M,)."""

    velocity: Float64Array
    time: float
    weights: Float64Array


class Habits:
    """Weights of each person's futures, from how its velocity changed."""

    def __init__(self) -> None:
        self._of: dict[int, _Habit] = {}

    def weights(
        self,
        people: Sequence[SeenObstacle],
        time: float,
        prior: Sequence[float],
        unseen: Collection[int] = (),
    ) -> Float64Array:
        """(N, M) probabilities of going on, stopping, turning left and right.

        Args:
            people: tracks in a frame that does not turn between calls. time: seconds.
            prior: M probabilities for a person of whom nothing is known.
            unseen: ids of those whose velocity is only predicted, which confirms no habit.
        """
        self._of = {i: h for i, h in self._of.items() if time - h.time < _FORGOTTEN_S}
        out = np.empty((len(people), len(prior)))
        for row, one in zip(out, people, strict=True):
            velocity = np.array([one.vx, one.vy])
            habit = self._of.get(one.id)
            if one.id in unseen:
                row[:] = prior if habit is None else _faded(habit.weights, time - habit.time, prior)
                continue
            if habit is None:
                habit = _Habit(velocity, time, np.array(prior))
            elif time - habit.time >= _LOOK_S:
                habit = _looked(habit, velocity, time, one.velocity_sigma_mps, prior)
            self._of[one.id] = habit
            row[:] = habit.weights
        return out


def _looked(
    habit: _Habit,
    velocity: Float64Array,
    time: float,
    sigma_mps: float | None,
    prior: Sequence[float],
) -> _Habit:
    """Return the habit updated by how well each manoeuvre explains the new velocity."""
    passed = time - habit.time
    short = 1e-3
    ways = displaced(habit.velocity[None], np.array([passed, passed + short]))[0]
    expected = (ways[:, 1] - ways[:, 0]) / short
    variance = _MANOEUVRE_MPS**2 + (sigma_mps or 0.0) ** 2
    squared = ((expected - velocity) ** 2).sum(axis=1)
    # Relative to the best of those that are possible at all, so that not all of them vanish.
    least = squared[habit.weights > 0].min()
    likelihood = np.exp(np.minimum(least - squared, 0.0) / (2 * variance))
    weights = habit.weights * likelihood
    weights /= weights.sum()
    return _Habit(velocity, time, _faded(weights, passed, prior))


def _faded(weights: Float64Array, passed_s: float, prior: Sequence[float]) -> Float64Array:
    """Return the weights after a time, closer to the prior with every full interval."""
    kept = (1 - _FORGETTING) ** (passed_s // _LOOK_S)
    return np.asarray(kept * weights + (1 - kept) * np.array(prior))
