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
from observer.guard.sight import SeenObstacle
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
        seen: by ``AHEAD_S``, of people seen in the frame of the prediction. remembered: of those
            not seen in it, but at most ``navigation.memory_s`` before.
    """

    walk: Walk
    seen: tuple[tuple[float, ...], ...]
    remembered: tuple[tuple[float, ...], ...]


def follow(walk: Walk, planner: NavigationParameters) -> WalkResult:
    """Watch people for 20 s, predict them, and compare with where they end up.

    Predicted is whomever a robot on its way would take into account: everybody in view, and those
    who left it lately.
    """
    crowd = Crowd(ROOM, walk.density_per_m2, walk.seed, kind=False, keep_clear=(*START, 1.0))
    perception, habits = ModelledPerception(walk.seed), Habits()
    rng = np.random.default_rng([walk.seed, 2])
    pose = np.array([*START, 0.0])
    times = np.array(AHEAD_S)
    ranked = {seen: [list[float]() for _ in AHEAD_S] for seen in (True, False)}
    # Newest sight of each person, and its time.
    known: dict[int, tuple[SeenObstacle, float]] = {}
    # Pending predictions: step that they are for, index of the horizon, whether the people were
    # seen, and the prediction.
    predicted: list[tuple[int, int, bool, Futures]] = []
    for step in range(math.ceil(_WALK_S / FRAME_S)):
        time = step * FRAME_S
        people = crowd.people
        for instant, seen, future in [each[1:] for each in predicted if each[0] == step]:
            places = moved(people.position[list(future.ids)], np.array(inverse(pose)))
            ranked[seen][instant] += ranks(future, instant, places, rng).tolist()
        predicted = [each for each in predicted if each[0] > step]
        sight = perception.look(people, pose, ROOM, time)
        known |= {one.id: (one, time) for one in sight.obstacles if not one.coasting}
        known = {i: each for i, each in known.items() if time - each[1] < planner.memory_s}
        unseen = {number for number, each in known.items() if each[1] < time}
        weights = habits.weights([one for one, _ in known.values()], time, planner.prior, unseen)
        for seen in (True, False) if step % _EVERY == 0 else ():
            rows = [k for k, number in enumerate(known) if (number not in unseen) == seen]
            if not rows:
                continue
            chosen = [list(known.values())[k] for k in rows]
            future = futures(
                [one for one, _ in chosen],
                weights[rows],
                times,
                planner.acceleration_noise,
                [time - since for _, since in chosen],
            )
            for instant, ahead in enumerate(AHEAD_S):
                predicted.append((step + round(ahead / FRAME_S), instant, seen, future))
        crowd.step(FRAME_S, (*START, 0.0, 0.0, SPEC.radius_m))
    by_sight = (tuple(tuple(each) for each in ranked[seen]) for seen in (True, False))
    return WalkResult(walk, *by_sight)
