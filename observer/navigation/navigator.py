"""Navigator of one robot: its state from frame to frame, and its plan for the next seconds.

All places are in one fixed frame, that of the robot's odometry. It reads no clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import ndtr

from observer.geometry import Float64Array, along_arc
from observer.guard.dead_reckoning import moved
from observer.guard.limiting import limit_of
from observer.guard.outline import Outline
from observer.guard.parameters import GuardParameters
from observer.guard.side import Side
from observer.guard.sight import SIGHT_FRESH_S, SeenObstacle, Sight
from observer.navigation.errand import REACHED_M, Errand
from observer.navigation.futures import futures, spread_of
from observer.navigation.habits import Habits
from observer.navigation.local_map import LocalMap
from observer.navigation.parameters import NavigationParameters
from observer.navigation.plan import Plan, RefusedPath
from observer.navigation.planner import TIMES, Choice, Permits, choose
from observer.navigation.reasons import Reason, reason_of
from observer.navigation.refusals import refused_paths
from observer.navigation.rollouts import Motion
from observer.navigation.surroundings import Surroundings
from observer.navigation.touch import Touch
from observer.occupancy import OccupancyMap
from observer.robots.contract import SonarReading
from observer.types import Status
from observer.vision.lifecycle import is_provisional

# Time unseen after which sonar may show a person to be gone, how much nearer than its centre a
# body echoes, and the probability with which it must have echoed if it were there.
_UNSEEN_S: Final = 0.35
_BODY_M: Final = 0.2
_PROBABLY: Final = 0.9
# Larger values of metres, m/s or radians are errors, as is NaN.
_IMPOSSIBLE: Final = 1e6
# Assumed for a robot that does not report its outline.
_RADIUS_M: Final = 0.3
# A slower person blocks the map like a static obstacle, for this long after each plan.
_STATIONARY_MPS, _STATIONARY_S = 0.15, 0.3
# A robot stands below this, m/s and rad/s.
_AT_REST: Final = 0.02
# People who could not come this near within the horizon are ignored.
_NEAR_M: Final = 2.0


@dataclass(frozen=True)
class _Known:
    """Track in the fixed frame, and when it was seen."""

    track: SeenObstacle
    seen: float

    def age_s(self, now: float) -> float:
        """Return the seconds since it was seen."""
        return max(now - self.seen, 0.0)

    def carried(self, now: float) -> SeenObstacle:
        """Return the track where it is if it went on as it was seen to."""
        one, age = self.track, self.age_s(now)
        return replace(one, x=one.x + one.vx * age, y=one.y + one.vy * age)


class Navigator:
    """Navigator of one robot; see the module."""

    def __init__(self, limits: GuardParameters, planner: NavigationParameters) -> None:
        """``limits``: parameters of the guard, which limits every plan."""
        self._limits = limits
        self._planner = planner
        self._known: dict[int, _Known] = {}
        self._habits = Habits()
        self._map = LocalMap()
        self._touch = Touch()
        # What the guard knows from the same sights, sonar and wheels.
        self._side = Side()
        self._sight: Sight | None = None
        # Whether the newest frame contains impossible values.
        self._odd = False
        # Pose of the base at the newest frame; None where that frame is not usable.
        self._pose: Float64Array | None = None

    def use(self, limits: GuardParameters, planner: NavigationParameters) -> None:
        """Use these parameters from now on."""
        self._limits = limits
        self._planner = planner

    def see(self, sight: Sight, pose: Float64Array) -> None:
        """Take in a frame.

        Args:
            pose: (3,) x, y, yaw of the robot's base in the frame of its odometry at the frame's
                reception, metres and radians.
        """
        self._sight = sight
        self._odd = not (_usable(*pose.tolist()) and all(map(_usable_track, sight.obstacles)))
        self._pose = None
        if sight.status is not Status.OK or self._odd:
            return
        self._pose = pose
        for one in sight.obstacles:
            if not one.coasting or one.id not in self._known:
                self._known[one.id] = _Known(_standing(one, pose), sight.received)
        self._forget_renumbered(sight)
        self._map.move_to(float(pose[0]), float(pose[1]))
        if sight.scan is not None:
            self._map.see(sight.scan, sight.obstacles, pose, sight.received)

    def _forget_renumbered(self, sight: Sight) -> None:
        """Forget tentative tracks that are seen under another number, as they were confirmed."""
        numbers = {one.id for one in sight.obstacles}
        there = [self._known[one.id].track for one in sight.obstacles if not one.coasting]
        for number, known in list(self._known.items()):
            if is_provisional(number) and number not in numbers:
                before = known.carried(sight.received)
                if any(_overlap(before, one) for one in there):
                    del self._known[number]

    def local_map(self) -> OccupancyMap | None:
        """Return the current map of the ground; None where the newest frame is not usable."""
        if self._sight is None or self._pose is None:
            return None
        return self._map.snapshot(self._pose, self._sight.received)

    def plan(self, errand: Errand, now: float) -> Plan:
        """Return the plan for the next seconds of an errand.

        Args:
            now: the host's monotonic clock.
        """
        if not _usable_errand(errand, now):
            return self._standing(errand, now, "Waiting: the robot reports impossible values.")
        motion = _motion(errand, now)
        self._follow_guard(errand, now)
        self._map.hear(
            errand.sonars,
            self._then(errand.sonars),
            np.array([motion.x, motion.y, motion.yaw]),
        )
        self._touch.hear(errand.sonars, _outline(errand))
        left = math.hypot(errand.goal.x - motion.x, errand.goal.y - motion.y)
        if left <= REACHED_M:
            return self._standing(errand, now, "The goal is reached.")
        trouble = self._trouble(now) or self._touched(errand, now)
        if trouble is not None:
            return self._standing(errand, now, trouble)
        radius = _RADIUS_M if errand.radius_m is None else errand.radius_m
        self._forget_where_clear(errand.sonars, motion, now)
        known = self._people(motion, now)
        tracks, planner = [one.track for one in known], self._planner
        weights = self._habits.weights(tracks, now, planner.prior, self._out_of_view())
        people = futures(
            tracks, weights, TIMES, planner.acceleration_noise, [one.age_s(now) for one in known]
        )
        for each in known:
            if math.hypot(each.track.vx, each.track.vy) < _STATIONARY_MPS:
                self._map.stand(each.carried(now), now + _STATIONARY_S)
        around = Surroundings.of(
            self._map,
            (errand.goal.x, errand.goal.y),
            motion,
            radius + self._limits.margin_m,
            now,
        )
        permits = self._permits(errand, now)
        choice = choose(
            motion,
            around,
            people,
            self._limits,
            planner,
            errand.goal.risk_per_metre,
            permits,
        )
        refused = refused_paths(choice, people, motion, around.goal)
        return self._plan(errand, choice, reason_of(choice, people, left), refused)

    def _plan(
        self, errand: Errand, choice: Choice, why: Reason, refused: tuple[RefusedPath, ...]
    ) -> Plan:
        assert self._sight is not None
        speed, turn = choice.velocity
        poses = choice.ways.poses[choice.best]
        path = () if choice.is_standstill else tuple((x, y) for x, y, _ in poses.tolist())
        return Plan(
            goal=errand.goal.number,
            received=self._sight.received,
            speed_mps=speed,
            turn_rate_radps=turn,
            path=path,
            risk_per_metre=choice.risk_per_metre,
            reason=why.sentence,
            waits_for=why.track,
            meets_s=why.meets_s,
            meets_at=why.meets_at,
            refused=refused,
        )

    def _standing(self, errand: Errand, now: float, reason: str) -> Plan:
        received = now if self._sight is None else self._sight.received
        return Plan(errand.goal.number, received, 0.0, 0.0, (), 0.0, reason)

    def _trouble(self, now: float) -> str | None:
        """Return why nothing can be planned, one sentence."""
        sight = self._sight
        if sight is None or now - sight.received > SIGHT_FRESH_S:
            return "Waiting for a camera frame."
        if sight.status is not Status.OK:
            why = f": {sight.reasons[0]}" if sight.reasons else ""
            return f"Waiting: vision is {sight.status.value}{why}."
        if self._odd:
            return "Waiting: the camera frame contains impossible values."
        return None

    def _touched(self, errand: Errand, now: float) -> str | None:
        """Return why a standing robot must not set off yet, one sentence."""
        if max(abs(errand.speed_mps), abs(errand.turn_rate_radps)) > _AT_REST:
            return None
        sonar = self._touch.sonar(now)
        return None if sonar is None else f"Waiting: sonar {sonar} detects something at the robot."

    def _forget_where_clear(
        self, sonars: Sequence[SonarReading], motion: Motion, now: float
    ) -> None:
        """Forget people out of view of whom sonar heard nothing where they should have been."""
        p = self._limits
        fresh = [one for one in sonars if now - one.received <= p.sonar_fresh_s]
        if not fresh:
            return
        # Each reading is compared with where robot and person were when it was made.
        past = self._then(fresh)
        gone = [
            number
            for number, known in self._known.items()
            if any(
                sonar.received - known.seen >= _UNSEEN_S
                and self._is_clear(known, motion, sonar, then)
                for sonar, then in zip(fresh, past, strict=True)
            )
        ]
        for number in gone:
            del self._known[number]

    def _then(self, sonars: Sequence[SonarReading]) -> Float64Array:
        """(S, 3) pose of the base as it stands now, in that of each reading."""
        return self._side.past.then_from_now(np.array([one.received for one in sonars]))

    def _is_clear(
        self, known: _Known, motion: Motion, sonar: SonarReading, then: Float64Array
    ) -> bool:
        """Return whether a reading shows that a person was not where predicted.

        The cone must cover that place, and its uncertainty so far that the person would very
        probably have echoed.

        Args:
            motion: of the robot now. then: (3,) pose of the base as it stands now, in that of the
                reading.
        """
        p, one = self._limits, known.carried(sonar.received)
        ((x, y),) = moved(np.array([_in_base(one, motion)]), then).tolist()
        c, s = math.cos(sonar.heading), math.sin(sonar.heading)
        dx, dy = x - sonar.x, y - sonar.y
        along, aside, away = c * dx + s * dy, c * dy - s * dx, math.hypot(dx, dy)
        half = along * math.tan(math.radians(p.sonar_half_angle_deg))
        echo = math.inf if sonar.range_m is None else sonar.range_m
        reach = min(echo - _BODY_M, p.sonar_reach_m)
        if abs(aside) >= half or away >= reach:
            return False
        age = np.array([known.age_s(sonar.received)])
        (sigma,) = spread_of(one, age, self._planner.acceleration_noise).tolist()
        # Any part of the body echoes.
        edges = np.array([half + one.radius_m - aside, -half - one.radius_m - aside])
        left, right = ndtr(edges / sigma).tolist()
        return bool((left - right) * ndtr((reach - away) / sigma) >= _PROBABLY)

    def _people(self, motion: Motion, now: float) -> list[_Known]:
        """Return the people who matter."""
        memory = self._planner.memory_s
        self._known = {i: k for i, k in self._known.items() if now - k.seen < memory}
        return [one for one in self._known.values() if self._matters(one.carried(now), motion)]

    def _out_of_view(self) -> frozenset[int]:
        """Return the numbers of the people not seen in the newest frame."""
        newest = math.inf if self._sight is None else self._sight.received
        return frozenset(number for number, known in self._known.items() if known.seen < newest)

    def _matters(self, one: SeenObstacle, motion: Motion) -> bool:
        speed = math.hypot(one.vx, one.vy) + self._limits.speed_max_mps
        away = math.hypot(one.x - motion.x, one.y - motion.y)
        return away < speed * float(TIMES[-1]) + _NEAR_M

    # --- the guard's rules -----------------------------------------------------------------

    def _follow_guard(self, errand: Errand, now: float) -> None:
        side = self._side
        side.advance(now, (errand.speed_mps, errand.turn_rate_radps))
        if self._sight is not None:
            side.see(self._sight)
        side.watch.listen(errand.sonars, now, side.past, self._limits)

    def _permits(self, errand: Errand, now: float) -> Permits:
        outline = _outline(errand)
        answers: dict[tuple[float, float], tuple[float, str | None]] = {(0.0, 0.0): (1.0, None)}

        def permits(asked: tuple[float, float]) -> tuple[float, str | None]:
            if asked not in answers:
                limit = limit_of(
                    self._side, asked, self._sight, errand.sonars, outline, self._limits, now
                )
                answers[asked] = (limit.share, limit.reason)
            return answers[asked]

        return permits


def _usable(*values: float | None) -> bool:
    """Return whether numbers are plausible; unknown ones are."""
    return all(value is None or abs(value) < _IMPOSSIBLE for value in values)


def _usable_track(one: SeenObstacle) -> bool:
    sigmas = one.position_sigma_m, one.velocity_sigma_mps
    least = one.radius_m, *(sigma or 0.0 for sigma in sigmas)
    return _usable(one.x, one.y, one.vx, one.vy, *least) and min(least) >= 0


def _usable_errand(errand: Errand, now: float) -> bool:
    goal = errand.goal
    moves = errand.speed_mps, errand.turn_rate_radps
    sizes = errand.radius_m, errand.width_m, errand.length_m
    return (
        _usable(goal.x, goal.y, goal.risk_per_metre, errand.x, errand.y, errand.yaw)
        and _usable(*moves, *sizes)
        and math.isfinite(errand.time)
        and math.isfinite(now)
    )


def _outline(errand: Errand) -> Outline:
    return Outline.of(errand.length_m, errand.width_m, errand.radius_m)


def _motion(errand: Errand, now: float) -> Motion:
    """Return where the robot is now if it kept its reported velocity."""
    dt = min(max(now - errand.time, 0.0), SIGHT_FRESH_S)
    distance, turned = errand.speed_mps * dt, errand.turn_rate_radps * dt
    x, y = along_arc(errand.x, errand.y, errand.yaw, distance, turned)
    return Motion(x, y, errand.yaw + turned, errand.speed_mps, errand.turn_rate_radps)


def _standing(one: SeenObstacle, pose: Float64Array) -> SeenObstacle:
    """Transform a track from the base frame to the frame in which the base has the pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return replace(
        one,
        x=float(pose[0] + c * one.x - s * one.y),
        y=float(pose[1] + s * one.x + c * one.y),
        vx=c * one.vx - s * one.vy,
        vy=s * one.vx + c * one.vy,
    )


def _overlap(one: SeenObstacle, other: SeenObstacle) -> bool:
    return math.hypot(one.x - other.x, one.y - other.y) < one.radius_m + other.radius_m


def _in_base(one: SeenObstacle, motion: Motion) -> tuple[float, float]:
    """Return a track's place relative to the robot: metres ahead and to the left."""
    c, s = math.cos(motion.yaw), math.sin(motion.yaw)
    dx, dy = one.x - motion.x, one.y - motion.y
    return c * dx + s * dy, c * dy - s * dx
