"""Choice of a path to a goal around people, made anew with every frame.

Two questions are asked of every path that the robot could take. Is it *permitted*: may the robot
begin it and still stop, with no more than the declared risk on each metre until it stands? That is
the chance constraint, and it holds for all that is driven before the next choice. And how *good* is
it: how much nearer does it lead to the goal, and how likely does it lead into somebody over the
seconds after, which later choices may still avoid? So a risk that lies far ahead steers the robot
aside or behind somebody, and only a near one stops it.

What the guard would permit is asked last and only of the best paths, as it takes longest.
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
# Metres that running into what stands costs.
_WALL_M: Final = 8.0
# Metres that a radian of heading missed at the end, and a change of turn rate by 1 rad/s, cost.
_HEADING_M, _SMOOTH_M = 0.15, 0.04
# Questions to the guard; each takes 0.2 ms.
_MOST_QUESTIONS: Final = 25
# The robot does not begin what the guard would all but stop.
_LEAST_SHARE: Final = 0.05
# The risk of what is driven until the next choice is not divided by less than this way, metres.
_LEAST_WAY_M: Final = 0.1
# Share of the velocity (m/s forward, rad/s to the left) that the guard would permit, and why less.
Permits = Callable[[tuple[float, float]], tuple[float, str | None]]


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen path among those that were looked at.

    Attributes:
        ways: all of them. best: the number of the chosen one.
        cost: (C,) metres that each is worse than arriving at once; alone: the same, people and
            surfaces left aside.
        hits_s: (C,) seconds until each runs into a surface, infinite for never.
        per_metre: (C,) risk of each on each metre until the robot could stand.
        near, far: risk of all until the robot stands, and over the whole horizon.
        permitted: (C,) by the risk alone.
        wished: the number of the one that would be best if the risk now and the guard did not
            count. refusal: the guard's sentence about it, None where it permits it.
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
        """Return that of the chosen one."""
        return float(self.per_metre[self.best])

    @property
    def stands(self) -> bool:
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
            frame that stands.
        limits: of the robot, the guard's. planner: what paths cost.
        risk_per_metre: declared. permits: asks the guard.
    """
    ways = rollouts(now, around.heading, around.left_m(now), TIMES, limits)
    near, per_metre = _risk_until_standing(ways, people, around.radius_m, limits)
    permitted = per_metre <= risk_per_metre
    # To stand is always permitted.
    permitted[STANDING] = True
    # Later instants count less, for choices that are made until then.
    foresight = np.exp(-ways.times / planner.foresight_s)
    counts = np.broadcast_to(foresight, ways.speed.shape)
    far = risk_of(ways, people, around.radius_m + planner.berth_m, counts)
    # Near somebody the guard lets it drive slowly only; to stand there costs no more than the time.
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
    """Return the cheapest path once what the guard refuses is added to its cost.

    And the guard's sentence about each path that it refuses altogether. The guard only ever adds,
    so the first path that is cheapest after its question is final.

    Args:
        refused_m: that a velocity costs of which the guard permits nothing.
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
    # Paths that begin alike are one question.
    return round(speed, 2), round(turn, 2)


def _risk_until_standing(
    ways: Rollouts, people: Futures, radius_m: float, limits: GuardParameters
) -> tuple[Risk, Float64Array]:
    """Return the risk of each path until the robot stands, by person and (C,) per metre.

    It is what driving adds: whoever would walk into the robot if it braked at once is not its
    doing, and a path away from him is no worse.
    """
    reaction = max(1, math.ceil(limits.reaction_s / STEP_S))
    stopped = braked(ways, reaction, limits)
    # Whoever it stands beside may walk into it: that is not its doing.
    moves = np.asarray(stopped.speed > 1e-3, np.float64)
    near = risk_of(stopped, people, radius_m, moves)
    still = stopped.only(STANDING)
    anyway = risk_of(still, people, radius_m, np.ones_like(still.speed)).each
    near = Risk(np.maximum(near.each - anyway, 0.0), near.when_s)
    return near, near.total / np.maximum(stopped.way_m(), _LEAST_WAY_M)


def _cost(ways: Rollouts, now: Motion, around: Surroundings) -> Float64Array:
    """(C,) metres that each path is worse than arriving at once, if nothing were in the way."""
    left = around.distance(ways.poses[:, :, :2])
    # Arriving early counts as much as being near at the end.
    cost = 0.5 * left[:, -1] + 0.5 * left.mean(axis=1)
    last = ways.poses[:, -1]
    dx, dy = around.goal[0] - last[:, 0], around.goal[1] - last[:, 1]
    missed = np.abs(wrapped(np.arctan2(dy, dx) - last[:, 2]))
    cost += _HEADING_M * np.where(np.hypot(dx, dy) > REACHED_M, missed, 0.0)
    return np.asarray(cost + _SMOOTH_M * np.abs(ways.turn[:, 0] - now.turn_rate_radps) / STEP_S)
