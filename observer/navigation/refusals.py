"""Paths that a robot could have taken, and why it does not."""

from __future__ import annotations

import math
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.navigation.futures import Futures
from observer.navigation.plan import MOST_REFUSED, RefusedPath
from observer.navigation.planner import Choice
from observer.navigation.reasons import LEAST_CHANCE, LESS_CHANCE
from observer.navigation.risk import Risk
from observer.navigation.rollouts import STANDING, Motion, wrapped

# Least angle between the ends of two paths, seen from the robot.
SPREAD_RAD: Final = math.radians(10)
# Shorter paths cannot be distinguished from standing still.
_SHORTEST_M: Final = 0.15
_PLACES: Final = 5
# Finer differences cannot be seen.
_PLACE_DIGITS, _DIGITS = 2, 3


def refused_paths(
    choice: Choice, people: Futures, now: Motion, goal: tuple[float, float]
) -> tuple[RefusedPath, ...]:
    """Return the best of the rejected paths in each of several directions, the best one first.

    Args:
        choice: made for the robot as it is ``now``, around ``people``. goal: x, y metres.
    """
    ends = choice.ways.poses[:, -1, :2]
    away = ends - (now.x, now.y)
    long = np.hypot(away[:, 0], away[:, 1]) >= _SHORTEST_M
    candidates = np.flatnonzero(long & _refused(choice, goal))
    directions = wrapped(np.arctan2(away[:, 1], away[:, 0]) - now.yaw).tolist()
    chosen: list[int] = []
    for way in candidates[np.argsort(choice.cost[candidates], kind="stable")].tolist():
        if all(_apart(directions[way], directions[one]) >= SPREAD_RAD for one in chosen):
            chosen.append(way)
        if len(chosen) == MOST_REFUSED:
            break
    return tuple(_described(choice, people, way, directions[way]) for way in chosen)


def _refused(choice: Choice, goal: tuple[float, float]) -> NDArray[np.bool_]:
    """(C,) which paths are forbidden, or not taken although they lead nearer to the goal."""
    best, far = choice.best, choice.far
    refused = ~choice.permitted
    refused[list(choice.refusals)] = True
    meets = far.each.max(axis=1, initial=0.0) >= LEAST_CHANCE
    meets &= far.total > far.total[best] + LESS_CHANCE
    refused |= meets & (choice.alone < choice.alone[best])
    ends = choice.ways.poses[:, -1, :2] - goal
    left = np.hypot(ends[:, 0], ends[:, 1])
    refused |= (choice.hits_s < choice.hits_s[best]) & (left < left[best])
    refused[STANDING] = False
    return refused


def _described(choice: Choice, people: Futures, way: int, direction: float) -> RefusedPath:
    poses = choice.ways.poses[way]
    some = np.linspace(0, len(poses) - 1, _PLACES).round().astype(int)
    described = partial(
        RefusedPath,
        round(direction, _DIGITS),
        round(float(choice.ways.speed[way].max()), _DIGITS),
        tuple(
            (round(x, _PLACE_DIGITS), round(y, _PLACE_DIGITS)) for x, y, _ in poses[some].tolist()
        ),
    )
    if not choice.permitted[way]:
        who, meets_s = _met(choice.near, way)
        per_metre = min(float(choice.per_metre[way]), 1.0)
        return described("risk", risk=per_metre, track=people.ids[who], meets_s=meets_s)
    if way in choice.refusals:
        return described("guard", guard=choice.refusals[way])
    if choice.far.each[way].max(initial=0.0) >= LEAST_CHANCE:
        who, meets_s = _met(choice.far, way)
        chance = float(choice.far.each[way, who])
        return described("later", risk=chance, track=people.ids[who], meets_s=meets_s)
    return described("surface", meets_s=round(float(choice.hits_s[way]), _DIGITS))


def _met(risk: Risk, way: int) -> tuple[int, float]:
    """Return the index of the person most likely to be met, and when."""
    who = int(np.argmax(risk.each[way]))
    return who, round(float(risk.when_s[way, who]), _DIGITS)


def _apart(one: float, other: float) -> float:
    return abs(math.remainder(one - other, 2 * math.pi))
