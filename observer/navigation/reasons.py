"""Why a robot does what it does on its way to a goal, in one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.navigation.futures import Futures
from observer.navigation.planner import Choice

# Less probable contacts decide nothing.
_LEAST_CHANCE: Final = 0.02
# More turn than this is not straight ahead, and less speed is a turn on the spot.
_TURNS_RADPS, _ON_THE_SPOT_MPS = 0.2, 0.03


@dataclass(frozen=True)
class Reason:
    """Reason of a choice.

    Attributes:
        sentence: for people.
        track: number of the obstacle that decided; None for none. meets_s: seconds until the
            robot would meet it on the path that it would take otherwise.
    """

    sentence: str
    track: int | None = None
    meets_s: float | None = None


def reason_of(choice: Choice, people: Futures, left_m: float) -> Reason:
    """Return why this path was chosen.

    Args:
        people: as they were given to the choice. left_m: straight distance to the goal, metres.
    """
    decider = _decider(choice, people)
    if choice.stands:
        return _standing(choice, decider)
    if decider is not None and choice.best != choice.wished:
        return replace_words(decider, _passing(choice, people, decider))
    speed, turn = choice.velocity
    if speed < _ON_THE_SPOT_MPS and abs(turn) > _TURNS_RADPS:
        return Reason("Turning towards the goal.")
    return Reason(f"Driving to the goal, {left_m:.1f} m away.")


def replace_words(reason: Reason, sentence: str) -> Reason:
    """Return the same reason in other words."""
    return Reason(sentence, reason.track, reason.meets_s)


def _standing(choice: Choice, decider: Reason | None) -> Reason:
    if decider is not None:
        return decider
    if choice.refusal is not None:
        return Reason(f"Waiting: {choice.refusal}.")
    return Reason("Waiting: no path leads on.")


def _decider(choice: Choice, people: Futures) -> Reason | None:
    """Return who keeps the robot from the straight path: by the risk now, or over the horizon."""
    if not len(people):
        return None
    straight = 1
    risk = choice.far if choice.permitted[straight] else choice.near
    chance = risk.each[straight]
    who = int(np.argmax(chance))
    if chance[who] < _LEAST_CHANCE and choice.permitted[straight]:
        return None
    track, meets = people.ids[who], float(risk.when_s[straight, who])
    named = "an object that starts to move" if track < 0 else f"obstacle {track}"
    return Reason(f"Waiting for {named}: they would meet in {meets:.1f} s.", track, meets)


def _passing(choice: Choice, people: Futures, decider: Reason) -> str:
    """Return on which side of an obstacle the path leads past."""
    who = people.ids.index(decider.track)
    # As it most probably goes on.
    way = people.mean[who, int(np.argmax(people.weight[who]))]
    moves = way[-1] - way[0]
    named = decider.sentence.removeprefix("Waiting for ").partition(":")[0]
    if math.hypot(*moves) < 0.2:
        return f"Driving around {named}."
    path = choice.ways.poses[choice.best, :, :2]
    away = path - way
    nearest = int(np.argmin(np.hypot(away[:, 0], away[:, 1])))
    behind = float(away[nearest] @ moves) < 0
    return f"Passing {'behind' if behind else 'in front of'} {named}."
