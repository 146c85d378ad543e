"""Oracle: the fastest way to the goal for a driver who knows where everybody is going to be.

It knows the future of people who ignore the robot, who therefore walk as in a run. The set of
places that the robot can reach grows from instant to instant at its highest speed, less the places
taken by people; the result is the first time at which that set reaches the goal. The robot turns
and brakes instantly, and only the largest circle within its outline must stay clear, so that no
driver can be faster.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.evaluation.navigation.crowd import Crowd, People
from observer.evaluation.navigation.perceived import FRAME_S
from observer.evaluation.navigation.robot import SPEC
from observer.evaluation.navigation.run import (
    CLEAR_M,
    GOAL,
    IN_TIME,
    ROOM,
    START,
    free_time_s,
)
from observer.guard.parameters import GuardParameters
from observer.navigation.errand import REACHED_M

_RADIUS_M: Final = min(SPEC.length_m, SPEC.width_m) / 2
# Dilating by a cross and a square in turn grows an octagon: in no direction slower than the robot,
# and at most 8 % faster.
_CROSS: Final = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
_SQUARE: Final = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Question:
    """Crowd about which the oracle is asked."""

    density_per_m2: float
    seed: int


@dataclass(frozen=True)
class Answer:
    """Answer of an oracle.

    Attributes:
        time_s: to the goal; None if it is not reached within ``IN_TIME`` times the free time.
    """

    question: Question
    time_s: float | None


def ask(question: Question, limits: GuardParameters) -> Answer:
    """Return the shortest time to the goal of a run among people who ignore the robot.

    Args:
        limits: of the robot.
    """
    crowd = Crowd(
        ROOM, question.density_per_m2, question.seed, kind=False, keep_clear=(*START, CLEAR_M)
    )
    cell = limits.speed_max_mps * FRAME_S
    count = np.ceil(ROOM.size / cell).astype(int)
    x, y = ((np.arange(each) + 0.5) * cell for each in count)
    centres = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    at_wall = ((centres < _RADIUS_M) | (ROOM.size - centres < _RADIUS_M)).any(axis=-1)
    at_goal = np.hypot(*np.moveaxis(centres - GOAL, -1, 0)) < REACHED_M
    reached = np.zeros(tuple(count), np.uint8)
    reached[tuple((np.array(START) / cell).astype(int))] = 1
    # Accelerating at the start costs as much time as in the free time.
    begins = limits.speed_max_mps / (2 * limits.acceleration_mps2)
    for step in range(1, math.floor(IN_TIME * free_time_s(limits) / FRAME_S) + 1):
        crowd.step(FRAME_S, (*START, 0.0, 0.0, SPEC.radius_m))
        time = step * FRAME_S
        if time > begins:
            reached = np.asarray(cv2.dilate(reached, _SQUARE if step % 2 else _CROSS), np.uint8)
        reached[at_wall | _taken(crowd.people, centres, cell)] = 0
        if reached[at_goal].any():
            return Answer(question, time)
    return Answer(question, None)


def _taken(people: People, centres: NDArray[np.float64], cell: float) -> NDArray[np.bool_]:
    """(X, Y) cells on which the robot would touch somebody."""
    taken = np.zeros(centres.shape[:2], np.bool_)
    for place, radius in zip(people.position, people.radius_m + _RADIUS_M, strict=True):
        low = np.maximum(np.floor((place - radius) / cell).astype(int), 0)
        high = np.maximum(np.ceil((place + radius) / cell).astype(int) + 1, 0)
        near = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        away = centres[near] - place
        taken[near] |= np.hypot(away[..., 0], away[..., 1]) < radius
    return taken
