"""Reasons for what a robot does on its way to a goal, in one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.guard.sight import obstacle_named
from observer.navigation.futures import Futures
from observer.navigation.planner import Choice

# Less probable contacts are not given as a reason; a path that is safer than straight ahead by
# this much was chosen for that.
LEAST_CHANCE: Final = 0.02
LESS_CHANCE: Final = 0.01
# Number of the path that leads straight ahead.
_STRAIGHT: Final = 1
# A higher turn rate is not straight ahead, and a lower speed is a turn on the spot.
_TURNS_RADPS, _ON_THE_SPOT_MPS = 0.2, 0.03
# Somebody who gets no farther than this within the horizon stands.
_STANDS_M: Final = 0.2
# Added to probabilities so that zero has a logarithm.
_NEVER: Final = 1e-12


@dataclass(frozen=True)
class Reason:
    """Reason for a choice.

    Attributes:
        sentence: for people.
        track: number of the obstacle that decided; None for none. meets_s: seconds until the
            robot would meet it on the straight path.
        meets_at: x, y where that obstacle is predicted to be then, metres.
    """

    sentence: str
    track: int | None = None
    meets_s: float | None = None
    meets_at: tuple[float, float] | None = None


def reason_of(choice: Choice, people: Futures, left_m: float) -> Reason:
    """Return why this path was chosen.

    Args:
        people: as they were given to the choice. left_m: straight distance to the goal, metres.
    """
    decider = _decider(choice, people)
    if choice.is_standstill:
        return _standing(choice, decider)
    if decider is not None and _turns_aside(choice, people, decider):
        return replace(decider, sentence=_passing(choice, people, decider))
    speed, turn = choice.velocity
    if speed < _ON_THE_SPOT_MPS and abs(turn) > _TURNS_RADPS:
        return Reason("Turning towards the goal.")
    return Reason(f"Driving to the goal, {left_m:.1f} m away.")


def _standing(choice: Choice, decider: Reason | None) -> Reason:
    guards = None if choice.refusal is None else f"Waiting: {choice.refusal}."
    if guards is not None and (decider is None or choice.permitted[choice.wished]):
        # Only the guard's rules stop it, perhaps because of the same obstacle.
        same = decider is not None and f"obstacle {decider.track} " in guards
        return replace(decider, sentence=guards) if decider is not None and same else Reason(guards)
    if decider is not None:
        return decider
    return Reason("Waiting: there is no acceptable path.")


def _turns_aside(choice: Choice, people: Futures, decider: Reason) -> bool:
    """Return whether the path differs from the one that would be driven without the obstacle."""
    if choice.best != choice.wished:
        return True
    chance = choice.far.each[:, _index(people, decider)]
    return bool(chance[_STRAIGHT] > chance[choice.best] + LESS_CHANCE)


def _decider(choice: Choice, people: Futures) -> Reason | None:
    """Return the obstacle that keeps the robot off the straight path, by near or later risk."""
    if not len(people):
        return None
    risk = choice.far if choice.permitted[_STRAIGHT] else choice.near
    chance = risk.each[_STRAIGHT]
    who = int(np.argmax(chance))
    if chance[who] < LEAST_CHANCE and choice.permitted[_STRAIGHT]:
        return None
    track, meets = people.ids[who], float(risk.when_s[_STRAIGHT, who])
    sentence = f"Waiting for {obstacle_named(track)}: it would cross in {meets:.1f} s."
    if _stands(people, who):
        sentence = f"Waiting: {obstacle_named(track)} is in the way."
    return Reason(sentence, track, meets, _predicted(choice, people, who, meets))


def _likeliest(people: Futures, who: int) -> Float64Array:
    """(K, 2) places of a person on the most probable manoeuvre."""
    return np.asarray(people.mean[who, int(np.argmax(people.weight[who]))])


def _stands(people: Futures, who: int) -> bool:
    way = _likeliest(people, who)
    return math.dist(way[-1], way[0]) < _STANDS_M


def _predicted(choice: Choice, people: Futures, who: int, meets_s: float) -> tuple[float, float]:
    """Return where a person is at an instant, on the manoeuvre likeliest to meet the robot."""
    instant = int(np.argmin(np.abs(people.times - meets_s)))
    places = people.mean[who, :, instant]
    gap = np.linalg.norm(places - choice.ways.poses[_STRAIGHT, instant, :2], axis=1)
    off = gap / people.sigma[who, :, instant]
    x, y = places[int(np.argmax(np.log(people.weight[who] + _NEVER) - off**2 / 2))].tolist()
    return x, y


def _passing(choice: Choice, people: Futures, decider: Reason) -> str:
    """Return the sentence that tells on which side the path passes an obstacle."""
    who = _index(people, decider)
    named = obstacle_named(people.ids[who])
    if _stands(people, who):
        return f"Driving around {named}."
    way = _likeliest(people, who)
    moves = way[-1] - way[0]
    path = choice.ways.poses[choice.best, :, :2]
    away = path - way
    nearest = int(np.argmin(np.hypot(away[:, 0], away[:, 1])))
    behind = float(away[nearest] @ moves) < 0
    return f"Passing {'behind' if behind else 'in front of'} {named}."


def _index(people: Futures, decider: Reason) -> int:
    assert decider.track is not None
    return people.ids.index(decider.track)
