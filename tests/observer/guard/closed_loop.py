"""A kinematic robot that drives as the guard permits, with sight and sonar made from the truth."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from observer.guard.guard import Guard, Level
from observer.guard.outline import Outline as BodyOutline
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.floor import Outline, Surroundings, outline_at
from observer.simulation.robots.sonar import sonar_range
from observer.types import Status

# Seconds. The tick is twice the drive loop's, for speed. GUARD_SEEDS asks for a wide sweep.
TICK_S, FRAME_S, LATENCY_S, LINK_S = 0.04, 1 / 15, 0.06, 0.08
SEEDS = int(os.environ.get("GUARD_SEEDS", "0"))
BRAKING = 0.6
ROOM = (-3.0, 5.0, -3.0, 3.0)
BEARINGS = np.radians(np.arange(-30.0, 30.1, 1.5))
AMIGO = robot_spec("amigo-sh")
Wish = Callable[[float], tuple[float, float]]


@dataclass
class Crosser:
    """A robot of 0.45 x 0.38 m that drives to and fro along a line regardless of obstacles.

    Attributes:
        begins: when it sets out, seconds from the beginning.
    """

    x: float
    y: float
    heading: float
    speed: float
    length: float = 4.0
    begins: float = -10.0

    def state(self, time: float) -> PlanarState:
        since = time - 10 - self.begins
        if since <= 0:
            return PlanarState(self.x, self.y, self.heading, 0.0, 0.0, 0.0)
        phase = (self.speed * since) % (2 * self.length)
        along, sign = (phase, 1) if phase < self.length else (2 * self.length - phase, -1)
        c, s = math.cos(self.heading), math.sin(self.heading)
        v = sign * self.speed
        return PlanarState(self.x + c * along, self.y + s * along, self.heading, c * v, s * v, 0.0)

    def outline(self, time: float) -> Outline:
        state = self.state(time)
        return Outline.of_box(state.x, state.y, state.heading, 0.45, 0.38)


@dataclass
class Lab:
    """Boxes, at most one crossing robot, and the driven robot."""

    boxes: tuple[Outline, ...] = ()
    crosser: Crosser | None = None
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    v: float = 0.0
    w: float = 0.0
    touched_mps: list[float] = field(default_factory=list)
    driven_m: float = 0.0
    levels: dict[Level, int] = field(default_factory=dict)
    seen_since: float | None = None
    reasons: set[str] = field(default_factory=set)

    def around(self, time: float) -> Surroundings:
        moving = () if self.crosser is None else (self.crosser.outline(time),)
        return Surroundings(ROOM, (*self.boxes, *moving))

    def state(self) -> PlanarState:
        return PlanarState(
            self.x, self.y, self.yaw, self.v * math.cos(self.yaw), self.v * math.sin(self.yaw), 0.0
        )

    def move(self, command: tuple[float, float], time: float, size: tuple[float, float]) -> None:
        self.v = _ramped(self.v, command[0], 0.3, BRAKING)
        self.w = _ramped(self.w, command[1], 1.5, 2.0)
        before = self.around(time).depth(outline_at(self.state(), *size))
        x, y, yaw = self.x, self.y, self.yaw
        self.yaw += self.w * TICK_S
        self.x += self.v * TICK_S * math.cos(self.yaw)
        self.y += self.v * TICK_S * math.sin(self.yaw)
        depth = self.around(time).depth(outline_at(self.state(), *size))
        if depth > 1e-6 and depth >= before:
            self.touched_mps.append(abs(self.v))
            self.x, self.y, self.yaw, self.v, self.w = x, y, yaw, 0.0, 0.0
        self.driven_m += abs(self.v) * TICK_S

    def sight(self, index: int, time: float, rng: random.Random) -> Sight:
        """Return the sight of a camera 0.4 m high: floor from 1 m on, obstacles 0.4 s late."""
        edges = self.around(time).edges()
        distance = np.array([ray(edges, self.x, self.y, self.yaw + b) for b in BEARINGS])
        distance += np.array([rng.gauss(0.0, 0.01) for _ in BEARINGS]) * distance
        to = np.minimum(distance - 0.03, 4.5)
        scan = FreeScan(
            tuple(BEARINGS.tolist()),
            tuple(float(d) if 0.55 < d < 4.8 else None for d in distance),
            tuple(1.0 if d > 1.0 else 0.0 for d in to),
            tuple(float(d) if d > 1.0 else 0.0 for d in to),
        )
        seen = self._seen(time, rng)
        return Sight(
            index, time, time, "w", Status.OK, (), True, () if seen is None else (seen,), scan
        )

    def _seen(self, time: float, rng: random.Random) -> SeenObstacle | None:
        if self.crosser is None:
            return None
        state = self.crosser.state(time)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = state.x - self.x, state.y - self.y
        x, y = c * dx + s * dy, c * dy - s * dx
        in_view = x > 0.4 and abs(math.atan2(y, x)) < math.radians(30)
        self.seen_since = (self.seen_since or time) if in_view else None
        if self.seen_since is None or time - self.seen_since < 0.4:
            return None
        vx = c * state.vx + s * state.vy + rng.gauss(0, 0.02)
        vy = c * state.vy - s * state.vx + rng.gauss(0, 0.02)
        return SeenObstacle(1, x, y, vx, vy, 0.29, 0.04, 0.03, False)


def drive(lab: Lab, wish: Wish, seconds: float, seed: int = 0, *, sonar: bool = True) -> Lab:
    guard, p, rng = Guard(GuardParameters()), GuardParameters(), random.Random(seed)
    size = (AMIGO.length_m, AMIGO.width_m)
    sonars: dict[int, SonarReading] = {}
    sights: list[Sight] = []
    commands: list[tuple[float, tuple[float, float]]] = []
    next_frame, frame, sent = 0.0, 0, (0.0, 0.0)
    for k in range(round(seconds / TICK_S)):
        time = 10 + k * TICK_S
        if time >= 10 + next_frame:
            sights.append(lab.sight(frame, time, rng))
            next_frame, frame = next_frame + FRAME_S, frame + 1
        if sonar:
            index = k % len(AMIGO.sonars)
            pose = AMIGO.sonars[index]
            echo = sonar_range(lab.around(time).edges(), lab.state(), pose)
            sonars[index] = SonarReading(index, pose.x, pose.y, pose.heading, echo, time)
        ready = [one for one in sights if one.received + LATENCY_S <= time]
        wanted = wish(time - 10)
        verdict = guard.limit(
            "observer", wanted, (lab.v, lab.w), ready[-1] if ready else None, "w",
            tuple(sonars.values()), BodyOutline(*size, AMIGO.radius_m), time,
        )  # fmt: skip
        if wanted != (0.0, 0.0) and ready:
            lab.levels[verdict.level] = lab.levels.get(verdict.level, 0) + 1
            lab.reasons.add(verdict.reason or "")
        sent = (
            _rising(sent[0], verdict.speed_mps, p.acceleration_mps2),
            _rising(sent[1], verdict.turn_rate_radps, p.turn_acceleration_radps2),
        )
        commands.append((time + LINK_S, sent))
        arrived = [command for at, command in commands if at <= time]
        lab.move(arrived[-1] if arrived else (0.0, 0.0), time, size)
        sights, commands = sights[-4:], commands[-8:]
    return lab


def share(lab: Lab, level: Level) -> float:
    return lab.levels.get(level, 0) / sum(lab.levels.values())


def steady(speed: float, turn: float = 0.0) -> Wish:
    return lambda time: (speed, turn) if time > 0.3 else (0.0, 0.0)


def wandering(seed: int, fastest: float) -> Wish:
    """Drive forward, in bends, on the spot and backward, for a second or two each."""
    rng = random.Random(seed)
    legs, time = [], 0.3
    while time < 30:
        speed, turn = rng.uniform(0.3, 1) * fastest, rng.uniform(-0.5, 0.5)
        wish = rng.choices(
            [(speed, 0.0), (speed, turn), (0.0, 2 * turn), (-speed, 0.0)], [5, 2, 1.5, 1.5]
        )[0]
        legs.append((time, wish))
        time += rng.uniform(0.8, 2.0)
    return lambda now: next((wish for at, wish in reversed(legs) if at <= now), (0.0, 0.0))


def ray(edges: np.ndarray, x: float, y: float, angle: float) -> float:
    """Return the distance along a ray to the nearest edge (N, 4), by Cramer's rule."""
    dx, dy = math.cos(angle), math.sin(angle)
    ax, ay = edges[:, 0] - x, edges[:, 1] - y
    ex, ey = edges[:, 2] - edges[:, 0], edges[:, 3] - edges[:, 1]
    determinant = ex * dy - ey * dx
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (ex * ay - ey * ax) / determinant
        across = (dx * ay - dy * ax) / determinant
    hit = (along > 0) & (across >= 0) & (across <= 1)
    return float(along[hit].min()) if hit.any() else 50.0


def _ramped(value: float, goal: float, up: float, down: float) -> float:
    if value * goal < 0:
        goal = 0.0
    most = (up if abs(goal) > abs(value) else down) * TICK_S
    return value + max(-most, min(most, goal - value))


def _rising(before: float, goal: float, rate: float) -> float:
    if goal * before >= 0 and abs(goal) <= abs(before):
        return goal
    start = before if goal * before > 0 else 0.0
    return start + max(-rate * TICK_S, min(rate * TICK_S, goal - start))
