"""One run of a robot through a crowd to a goal, with the real guard."""

from __future__ import annotations

import math
import re
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from observer.evaluation.navigation.contacts import ContactCounter, Contacts
from observer.evaluation.navigation.crowd import Crowd, People, Room
from observer.evaluation.navigation.imaged import RenderedPerception
from observer.evaluation.navigation.perceived import (
    FRAME_S,
    LATENCY_S,
    WORLD,
    ModelledPerception,
    SonarRing,
    in_view,
    turned,
)
from observer.evaluation.navigation.perception_check import PerceptionCheck, PerceptionChecker
from observer.evaluation.navigation.robot import SPEC, Robot
from observer.geometry import Float64Array
from observer.guard.guard import Guard, Verdict
from observer.guard.outline import Outline
from observer.guard.parameters import GuardParameters
from observer.guard.sight import Sight
from observer.navigation.errand import REACHED_M, Errand, Goal
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import AllParameters
from observer.navigation.plan import Plan

Driver = Literal["planner", "guard"]
DRIVERS: Final[tuple[Driver, ...]] = ("planner", "guard")
# The robot's perception: a model of the observer's errors, or rendered images.
Sees = Literal["model", "images"]
ROOM: Final = Room(14.0, 10.0)
START, GOAL = (2.0, 5.0), (12.0, 5.0)
CLEAR_M: Final = 1.5
# A goal counts as reached within this many times the free time, when the run ends.
IN_TIME: Final = 3.0
_SEEN_BEFORE_S: Final = 1.0


@dataclass(frozen=True)
class Case:
    """One run to be made; equal cases have equal results.

    Attributes:
        driver: ``planner``, or ``guard`` to drive straight and leave everything to the guard.
        kind: True for people who avoid the robot.
        risk_per_metre: declared; without effect on the driver ``guard``.
        sees: ``images`` only among people who do not avoid the robot.
    """

    driver: Driver
    density_per_m2: float
    kind: bool
    risk_per_metre: float
    seed: int
    sees: Sees = "model"


@dataclass(frozen=True)
class RunResult:
    """Result of one run.

    Attributes:
        reached: whether the goal was reached within ``IN_TIME`` times the free time. time_s: until
            then, or until it was given up. free_s: time to the goal without people.
        driven_m: driven.
        contacts: people touched.
        stops: number of stops by the guard, by reason.
        stopped_s, waited_s: time for which the guard, and the driver, kept the robot standing.
        perception: check of the perception against the true places of people.
    """

    case: Case
    reached: bool
    time_s: float
    free_s: float
    driven_m: float
    contacts: Contacts
    stops: dict[str, int]
    stopped_s: float
    waited_s: float
    perception: PerceptionCheck


@dataclass(frozen=True, eq=False)
class Moment:
    """One step of a run, for ``Watch``."""

    time: float
    pose: Float64Array
    people: People
    wanted: tuple[float, float]
    verdict: Verdict
    plan: Plan | None


Watch = Callable[[Moment], None]
_OUTLINE = Outline(SPEC.length_m, SPEC.width_m, SPEC.radius_m)


@dataclass
class _Tally:
    """Counts during a run; see ``RunResult``."""

    driven_m: float = 0.0
    contacts: ContactCounter = field(default_factory=ContactCounter)
    stops: Counter[str] = field(default_factory=Counter)
    stopped_s: float = 0.0
    waited_s: float = 0.0
    stopped: bool = False

    def verdict(self, verdict: Verdict, wanted: tuple[float, float]) -> None:
        """Count the guard's verdict on a wanted velocity."""
        stopped = verdict.level == "stop"
        if stopped and not self.stopped:
            self.stops[general(verdict.reason or "")] += 1
        self.stopped = stopped
        self.stopped_s += FRAME_S * stopped
        self.waited_s += FRAME_S * (wanted == (0.0, 0.0))


def run(case: Case, parameters: AllParameters, watch: Watch | None = None) -> RunResult:
    """Drive 10 m through a crowd.

    Args:
        parameters: of guard and planner. watch: called with every step.
    """
    limits = parameters.guard
    crowd = _crowd(case)
    robot, guard = Robot((*START, 0.0), limits), Guard(limits)
    perception = _perception(case, limits)
    navigator, ring = Navigator(limits, parameters.navigation), SonarRing(SPEC.sonars)
    goal = Goal(1, *GOAL, case.risk_per_metre)
    free_s = free_time_s(limits)
    frames: deque[tuple[Sight, Float64Array]] = deque()
    seen_lately: deque[frozenset[int]] = deque(maxlen=round(_SEEN_BEFORE_S / FRAME_S))
    tally, check = _Tally(), PerceptionChecker()
    for step in range(_steps(limits)):
        time = step * FRAME_S
        people = crowd.people
        frames.append((perception.look(people, robot.pose, ROOM, time), robot.pose.copy()))
        visible = in_view(people, robot.pose)
        check.add_sight(frames[-1][0], people, robot.pose, visible)
        while len(frames) > 1 and time - frames[1][0].received >= LATENCY_S - 1e-9:
            frames.popleft()
        sight, then = frames[0]
        heard = ring.listen(people, ROOM, robot.pose, time)
        errand = robot.errand(goal, heard, time)
        plan = None
        if case.driver == "planner":
            navigator.see(sight, then)
            plan = navigator.plan(errand, time)
            wanted = (plan.speed_mps, plan.turn_rate_radps)
        else:
            wanted = straight(errand, limits)
        verdict = guard.limit(
            "observer",
            wanted,
            (robot.speed_mps, robot.turn_rate_radps),
            sight,
            WORLD,
            heard,
            _OUTLINE,
            time,
        )
        tally.verdict(verdict, wanted)
        if watch is not None:
            watch(Moment(time, robot.pose.copy(), people, wanted, verdict, plan))
        seen_lately.append(frozenset(people.number[visible].tolist()))
        robot.drive(verdict.speed_mps, verdict.turn_rate_radps, FRAME_S)
        _walk(crowd, robot)
        tally.driven_m += abs(robot.speed_mps) * FRAME_S
        tally.contacts.touch(robot, crowd.people, seen_lately[0])
        if math.dist(robot.pose[:2], GOAL) < REACHED_M:
            return _result(case, tally, check, True, time + FRAME_S, free_s)
    return _result(case, tally, check, False, IN_TIME * free_s, free_s)


def _crowd(case: Case) -> Crowd:
    return Crowd(ROOM, case.density_per_m2, case.seed, kind=case.kind, keep_clear=(*START, CLEAR_M))


def _steps(limits: GuardParameters) -> int:
    return math.floor(IN_TIME * free_time_s(limits) / FRAME_S)


def _perception(case: Case, limits: GuardParameters) -> ModelledPerception | RenderedPerception:
    if case.sees == "model":
        return ModelledPerception(case.seed)
    if case.kind:
        raise ValueError("the paths of people who avoid the robot are not known before the run")
    crowd, steps = _crowd(case), []
    for _ in range(_steps(limits)):
        steps.append(crowd.people)
        crowd.step(FRAME_S, (*START, 0.0, 0.0, SPEC.radius_m))
    return RenderedPerception(steps, START, case.seed, limits)


def _walk(crowd: Crowd, robot: Robot) -> None:
    vx, vy = turned(np.array([robot.speed_mps, 0.0]), float(robot.pose[2])).tolist()
    x, y, _ = robot.pose.tolist()
    crowd.step(FRAME_S, (x, y, vx, vy, SPEC.radius_m))


def _result(
    case: Case, tally: _Tally, check: PerceptionChecker, reached: bool, time_s: float, free_s: float
) -> RunResult:
    return RunResult(
        case=case,
        reached=reached,
        time_s=time_s,
        free_s=free_s,
        driven_m=tally.driven_m,
        contacts=tally.contacts.result(),
        stops=dict(tally.stops),
        stopped_s=tally.stopped_s,
        waited_s=tally.waited_s,
        perception=check.result(),
    )


def straight(errand: Errand, limits: GuardParameters) -> tuple[float, float]:
    """Return the velocity straight to the goal, leaving everything else to the guard."""
    bearing = math.atan2(errand.goal.y - errand.y, errand.goal.x - errand.x)
    error = math.remainder(bearing - errand.yaw, 2 * math.pi)
    turn = float(np.clip(2 * error, -limits.turn_rate_max_radps, limits.turn_rate_max_radps))
    return limits.speed_max_mps * max(0.0, math.cos(error)), turn


def free_time_s(limits: GuardParameters) -> float:
    """Return the time to the goal without people, seconds."""
    distance, speed = math.dist(START, GOAL) - REACHED_M, limits.speed_max_mps
    return distance / speed + speed / (2 * limits.acceleration_mps2)


def general(reason: str) -> str:
    """Return a reason without numbers of obstacles and sonars, and without figures of vision.

    This way equal causes are counted together.
    """
    if reason.startswith("vision is"):
        return re.sub(r"\d+(\.\d+)?", "…", reason)
    return re.sub(r"\b(obstacle|sonar) \d+\b", r"\1", reason)
