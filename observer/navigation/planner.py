"""Choice of a path to a goal around people, repeated with every frame.

Every candidate path is judged twice. Is it *permitted*: can the robot begin it and still stop,
with no more than the declared risk per metre until it stands? That is the chance constraint, and
it holds for everything driven before the next choice. And how *good* is it: how much nearer does
it lead to the goal, and how likely is contact with somebody in the seconds after, which later
choices may still avoid? So a risk far ahead steers the robot aside or behind somebody, and only a
near one stops it.

The guard is asked last and only about the best paths, as that takes longest.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.parameters import GuardParameters
from observer.navigation.errand import REACHED_M
from observer.navigation.futures import Futures
from observer.navigation.parameters import NavigationParameters
from observer.navigation.risk import Risk, risk_of, seconds_near
from observer.navigation.rollouts import STANDING, Motion, Rollouts, braked, rollouts, wrapped
from observer.navigation.surroundings import Surroundings

STEP_S: Final = 0.2
TIMES: Final = np.asarray(np.arange(1, 21) * STEP_S, np.float64)
# Metres: cost of running into a static surface.
_WALL_M: Final = 8.0
# Metres: cost per radian of heading error at the end, and per rad/s^2 of turn acceleration.
_HEADING_M, _SMOOTH_M = 0.15, 0.04
# Most questions to the guard; each takes 0.2 ms.
_MOST_QUESTIONS: Final = 25
# The robot does not begin a path on which the guard would permit less than this share.
_LEAST_SHARE: Final = 0.05
# Metres: lower bound of the distance by which a risk per metre is divided.
_LEAST_DISTANCE_M: Final = 0.1
# Share of a velocity (m/s forward, rad/s to the left) that the guard would permit, and why not all.
Permits = Callable[[tuple[float, float]], tuple[float, str | None]]


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen path among the candidates.

    Attributes:
        ways: all of them. best: the number of the chosen one.
        cost: (C,) metres that each is worse than arriving at once; alone: the same without the
            costs of people and of running into surfaces.
        hits_s: (C,) seconds until each runs into a surface, infinite for never.
        per_metre: (C,) risk of each per metre until the robot could have stopped.
        near, far: risk of all until the robot has stopped, and over the whole horizon.
        permitted: (C,) by the risk alone.
        wished: the number of the one that would be best without the risk limit and the guard.
            refusal: the guard's sentence about it, None where the guard permits it.
        refusals: the guard's sentence about each that it was asked about and refuses.
    """

    ways: Rollouts
    best: int
    cost: Float64Array
    alone: Float64Array
    hits_s: Float64Array
    per_metre: Float64Array
    near: Risk
    far: Risk
    permitted: NDArray[np.bool_]
    wished: int
    refusal: str | None
    refusals: Mapping[int, str | None]

    @property
    def risk_per_metre(self) -> float:
        """Return the risk per metre of the chosen path."""
        return float(self.per_metre[self.best])

    @property
    def is_standstill(self) -> bool:
        """Return whether the robot is to stand."""
        return self.best == STANDING

    @property
    def velocity(self) -> tuple[float, float]:
        """Return the velocity to ask for now."""
        speed, turn = self.ways.asked[self.best].tolist()
        return speed, turn


def choose(
    now: Motion,
    around: Surroundings,
    people: Futures,
    limits: GuardParameters,
    planner: NavigationParameters,
    risk_per_metre: float,
    permits: Permits,
) -> Choice:
    """Return the path to take.

    Args:
        now: the robot. around: goal and surfaces. people: their futures at ``TIMES``; all in one
            fixed frame.
        limits: the guard's, of the robot. planner: costs of paths.
        risk_per_metre: declared. permits: asks the guard.
    """
    ways = rollouts(now, around.heading, around.left_m(now), TIMES, limits)
    near, per_metre = _risk_until_standing(ways, people, around.radius_m, limits)
    permitted = per_metre <= risk_per_metre
    # Standing is always permitted.
    permitted[STANDING] = True
    # Later instants count less, because new choices are made by then.
    foresight = np.exp(-ways.times / planner.foresight_s)
    counts = np.broadcast_to(foresight, ways.speed.shape)
    far = risk_of(ways, people, around.radius_m + planner.berth_m, counts)
    # Near people the guard permits only slow driving; standing there costs no more than its time.
    moving = counts * np.abs(ways.speed) / limits.speed_max_mps
    slowed = seconds_near(ways, people, around.radius_m + planner.near_m, moving)
    hits = around.hits(ways) > 0
    alone = _cost(ways, now, around)
    cost = alone + _WALL_M * (hits * foresight).max(axis=1)
    cost += planner.detour_m * far.total
    cost += planner.near_cost_mps * slowed
    wished = int(np.argmin(cost))
    best, refusals = _cheapest(ways, np.where(permitted, cost, np.inf), permits, planner.refused_m)
    _, refusal = permits(_asked(ways, wished)) if wished != STANDING else (1.0, None)
    hits_s = np.where(hits, ways.times, np.inf).min(axis=1)
    return Choice(
        *(ways, best, cost, alone, hits_s, per_metre),
        *(near, far, permitted, wished, refusal, refusals),
    )


def _cheapest(
    ways: Rollouts, cost: Float64Array, permits: Permits, refused_m: float
) -> tuple[int, dict[int, str | None]]:
    """Return the cheapest path with the guard's reductions added to its cost.

    Also return the guard's sentence about each path that it refuses altogether. The guard only
    ever adds cost, so the first path that is still cheapest after its question is final.

    Args:
        refused_m: cost of a velocity of which the guard permits nothing.
    """
    refusals: dict[int, str | None] = {}
    queue = [(float(each), k, False) for k, each in enumerate(cost) if np.isfinite(each)]
    heapq.heapify(queue)
    for _ in range(_MOST_QUESTIONS):
        least, way, answered = queue[0]
        if answered or way == STANDING:
            return way, refusals
        share, why = permits(_asked(ways, way))
        if share < _LEAST_SHARE:
            heapq.heappop(queue)
            refusals[way] = why
        else:
            heapq.heapreplace(queue, (least + refused_m * (1 - share), way, True))
    best = next((way for _, way, answered in sorted(queue) if answered), STANDING)
    return best, refusals


def _asked(ways: Rollouts, way: int) -> tuple[float, float]:
    speed, turn = ways.asked[way].tolist()
    # Rounded, so that paths that begin alike make one question.
    return round(speed, 2), round(turn, 2)


def _risk_until_standing(
    ways: Rollouts, people: Futures, radius_m: float, limits: GuardParameters
) -> tuple[Risk, Float64Array]:
    """Return the risk of each path until the robot stands, by person and (C,) per metre.

    Only the risk that driving adds counts: the robot is not to blame for a person who would walk
    into it even if it braked at once, and a path away from that person is no worse.

    That is taken over the whole horizon, so a person who would arrive only after the robot could
    have stopped counts neither. Taken over the same instants, it forbade more: among 0.1 people
    per m2 the robot drove a quarter less, with no fewer contacts.
    """
    reaction = max(1, math.ceil(limits.reaction_s / STEP_S))
    stopped = braked(ways, reaction, limits)
    # Contacts while the robot stands are not its fault, so those instants do not count.
    moves = np.asarray(stopped.speed > 1e-3, np.float64)
    near = risk_of(stopped, people, radius_m, moves)
    still = stopped.only(STANDING)
    anyway = risk_of(still, people, radius_m, np.ones_like(still.speed)).each
    near = Risk(np.maximum(near.each - anyway, 0.0), near.when_s)
    return near, near.total / np.maximum(stopped.driven_m(), _LEAST_DISTANCE_M)


def _cost(ways: Rollouts, now: Motion, around: Surroundings) -> Float64Array:
    """(C,) metres that each path is worse than arriving at once, without contacts."""
    left = around.distance(ways.poses[:, :, :2])
    # Arriving early counts as much as being near at the end.
    cost = 0.5 * left[:, -1] + 0.5 * left.mean(axis=1)
    last = ways.poses[:, -1]
    dx, dy = around.goal[0] - last[:, 0], around.goal[1] - last[:, 1]
    missed = np.abs(wrapped(np.arctan2(dy, dx) - last[:, 2]))
    cost += _HEADING_M * np.where(np.hypot(dx, dy) > REACHED_M, missed, 0.0)
    return np.asarray(cost + _SMOOTH_M * np.abs(ways.turn[:, 0] - now.turn_rate_radps) / STEP_S)
