"""Coverage of the predictions on walks to which nothing was tuned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.evaluation.navigation.crowd import Crowd
from observer.evaluation.navigation.perceived import FRAME_S, ModelledPerception
from observer.evaluation.navigation.robot import SPEC
from observer.evaluation.navigation.run import ROOM, START
from observer.guard.dead_reckoning import inverse, moved
from observer.navigation.calibration import ranks
from observer.navigation.futures import Futures, futures
from observer.navigation.habits import Habits
from observer.navigation.parameters import NavigationParameters

# Prediction horizons.
AHEAD_S: Final = (1.0, 2.0)
_WALK_S: Final = 20.0
_EVERY: Final = 2


@dataclass(frozen=True)
class Walk:
    """People watched by a standing robot.

    Attributes:
        density_per_m2: of the crowd.
    """

    density_per_m2: float
    seed: int


@dataclass(frozen=True)
class WalkResult:
    """Ranks of true places within the predictions of a walk, as from ``ranks``.

    Attributes:
        ranked: by ``AHEAD_S``.
    """

    walk: Walk
    ranked: tuple[tuple[float, ...], ...]


def follow(walk: Walk, planner: NavigationParameters) -> WalkResult:
    """Watch people for 20 s, predict everybody in view, and compare with where they end up."""
    crowd = Crowd(ROOM, walk.density_per_m2, walk.seed, kind=False, keep_clear=(*START, 1.0))
    perception, habits = ModelledPerception(walk.seed), Habits()
    rng = np.random.default_rng([walk.seed, 2])
    pose = np.array([*START, 0.0])
    times = np.array(AHEAD_S)
    ranked: list[list[float]] = [[] for _ in AHEAD_S]
    # Pending predictions: step that they are for, index of the horizon, and the prediction.
    predicted: list[tuple[int, int, Futures]] = []
    for step in range(math.ceil(_WALK_S / FRAME_S)):
        time = step * FRAME_S
        people = crowd.people
        for instant, future in [each[1:] for each in predicted if each[0] == step]:
            places = moved(people.position[list(future.ids)], np.array(inverse(pose)))
            ranked[instant] += ranks(future, instant, places, rng).tolist()
        predicted = [each for each in predicted if each[0] > step]
        sight = perception.look(people, pose, ROOM, time)
        seen = [one for one in sight.obstacles if not one.coasting]
        weights = habits.weights(seen, time, planner.prior)
        if seen and step % _EVERY == 0:
            future = futures(seen, weights, times, planner.acceleration_noise)
            for instant, ahead in enumerate(AHEAD_S):
                predicted.append((step + round(ahead / FRAME_S), instant, future))
        crowd.step(FRAME_S, (*START, 0.0, 0.0, SPEC.radius_m))
    return WalkResult(walk, tuple(tuple(each) for each in ranked))
