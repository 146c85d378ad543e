"""Motions over the floor as exact functions of time: poses and velocities in closed form.

Frame: the room's floor plane, x forward, y left, metres; heading counter-clockwise from x, rad.
Nothing is integrated step by step, so a state at any time is as exact as at time 0.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from observer.errors import ScenarioError
from observer.geometry import along_arc

# A course that ends this close to its start is closed and repeats without drift.
_CLOSED_M = 1e-6


@dataclass(frozen=True)
class PlanarState:
    """Pose and velocity of a vehicle at one instant.

    Attributes:
        x, y: metres. heading: radians. vx, vy: m/s. turn_rate: rad/s.
    """

    x: float
    y: float
    heading: float
    vx: float = 0.0
    vy: float = 0.0
    turn_rate: float = 0.0


def state_on_arc(
    start: PlanarState, distance: float, turned: float, speed: float, turn_rate: float
) -> PlanarState:
    """Return the state at the end of an arc that begins along the heading of ``start``.

    Args:
        distance: along the arc, metres. turned: over it, radians.
        speed: along the heading at its end, m/s. turn_rate: rad/s.
    """
    heading = start.heading + turned
    return PlanarState(
        *along_arc(start.x, start.y, start.heading, distance, turned),
        heading,
        speed * math.cos(heading),
        speed * math.sin(heading),
        turn_rate,
    )


class PlanarMotion(Protocol):
    """A motion over the floor, defined for every time >= 0."""

    def state(self, time: float) -> PlanarState: ...

    def commanded_speed(self, time: float) -> float:
        """Return the speed in m/s that a computer would command (a step, without ramps)."""
        ...


@dataclass(frozen=True)
class Parked:
    """A motion that stands still."""

    x: float
    y: float
    heading: float

    def state(self, time: float) -> PlanarState:  # noqa: ARG002
        return PlanarState(self.x, self.y, self.heading)

    def commanded_speed(self, time: float) -> float:  # noqa: ARG002
        return 0.0


@dataclass(frozen=True)
class Oscillation:
    """``amplitude * sin(2 pi time / period + phase)``.

    Attributes:
        amplitude: in the oscillating quantity's unit. period: seconds. phase: radians.
    """

    amplitude: float
    period: float
    phase: float = 0.0

    def value(self, time: float) -> float:
        return self.amplitude * math.sin(2 * math.pi * time / self.period + self.phase)

    def rate(self, time: float) -> float:
        """Return the derivative of ``value``, unit per second."""
        omega = 2 * math.pi / self.period
        return self.amplitude * omega * math.cos(omega * time + self.phase)


@dataclass(frozen=True)
class Sway:
    """Sine motion about a resting pose: forward, to the left and in heading.

    ``forward`` and ``left`` are along the axes of the resting heading, metres; ``turn`` radians.
    """

    x: float
    y: float
    heading: float
    forward: Oscillation
    left: Oscillation
    turn: Oscillation

    def state(self, time: float) -> PlanarState:
        c, s = math.cos(self.heading), math.sin(self.heading)
        f, df = self.forward.value(time), self.forward.rate(time)
        a, da = self.left.value(time), self.left.rate(time)
        return PlanarState(
            self.x + c * f - s * a,
            self.y + s * f + c * a,
            self.heading + self.turn.value(time),
            c * df - s * da,
            s * df + c * da,
            self.turn.rate(time),
        )

    def commanded_speed(self, time: float) -> float:
        return math.hypot(self.forward.rate(time), self.left.rate(time))


@dataclass(frozen=True)
class Ramp:
    """Speed over one leg: a ramp from ``start`` to ``cruise``, a hold, and a ramp to ``end``.

    Attributes:
        length: of the leg, >= 0, metres or radians.
        start, cruise, end: speeds >= 0, per second. acceleration: > 0, of both ramps.
    """

    length: float
    start: float
    cruise: float
    end: float
    acceleration: float

    @staticmethod
    def over(length: float, start: float, cruise: float, end: float, acceleration: float) -> Ramp:
        """Return the ramp to ``cruise``, or to a lower speed if the leg is too short for it.

        Raises:
            ScenarioError: the leg is too short to brake from ``start`` to ``end``.
        """
        reachable = math.sqrt((2 * acceleration * length + start**2 + end**2) / 2)
        if reachable < max(start, end) - 1e-9:
            raise ScenarioError(
                f"a leg of {length:g} m is too short to change the speed from {start:g} to {end:g} "
                f"m/s at {acceleration:g} m/s^2; make it longer or slower"
            )
        slower = cruise < start
        return Ramp(length, start, cruise if slower else min(cruise, reachable), end, acceleration)

    @property
    def _times(self) -> tuple[float, float, float]:
        """Durations of the first ramp, of the cruise and of the last ramp, seconds."""
        first = abs(self.cruise - self.start) / self.acceleration
        last = abs(self.cruise - self.end) / self.acceleration
        distance = self.length - first * (self.start + self.cruise) / 2
        distance -= last * (self.end + self.cruise) / 2
        return first, max(0.0, distance / self.cruise), last

    @property
    def duration(self) -> float:
        return sum(self._times)

    @property
    def braking_begins(self) -> float:
        """Seconds after the start at which the last ramp begins."""
        first, cruise, _ = self._times
        return first + cruise

    @property
    def cruise_begins(self) -> float:
        """Seconds after the start at which the first ramp ends."""
        return self._times[0]

    def distance_and_speed(self, time: float) -> tuple[float, float]:
        """Return distance and speed ``time`` seconds after the start."""
        first, cruise, last = self._times
        time = min(max(time, 0.0), first + cruise + last)
        if time <= first:
            a = math.copysign(self.acceleration, self.cruise - self.start)
            return self.start * time + a * time * time / 2, self.start + a * time
        distance = first * (self.start + self.cruise) / 2
        if time <= first + cruise:
            return distance + self.cruise * (time - first), self.cruise
        distance += self.cruise * cruise
        rest = time - first - cruise
        a = math.copysign(self.acceleration, self.end - self.cruise)
        return distance + self.cruise * rest + a * rest * rest / 2, self.cruise + a * rest


@dataclass(frozen=True)
class Leg:
    """One piece of a course.

    Attributes:
        distance: metres along the path, negative backwards; 0 for a turn on the spot or a wait.
        angle: radians turned to the left; with a distance the leg is an arc.
        speed: m/s >= 0 of a travelling leg. rate: rad/s > 0 of a turn on the spot.
        seconds: duration of a waiting leg.
    """

    distance: float = 0.0
    angle: float = 0.0
    speed: float = 0.0
    rate: float = 0.0
    seconds: float = 0.0

    @property
    def travels(self) -> bool:
        return self.distance != 0.0


@dataclass(frozen=True)
class _TimedLeg:
    leg: Leg
    ramp: Ramp | None
    begins: float
    duration: float
    start: PlanarState

    def state(self, time: float) -> PlanarState:
        """Return the state ``time`` seconds after the leg's own start."""
        start = self.start
        if self.ramp is None:
            return start
        distance, speed = self.ramp.distance_and_speed(time)
        if not self.leg.travels:
            sign = math.copysign(1.0, self.leg.angle)
            return PlanarState(
                start.x, start.y, start.heading + sign * distance, turn_rate=sign * speed
            )
        sign = math.copysign(1.0, self.leg.distance)
        distance, speed = sign * distance, sign * speed
        curvature = self.leg.angle / self.leg.distance
        return state_on_arc(start, distance, curvature * distance, speed, curvature * speed)

    def commanded_speed(self, time: float) -> float:
        if self.ramp is None or not self.leg.travels:
            return 0.0
        return self.leg.speed if time < self.ramp.braking_begins else self.ramp.end

    def commanded_speed_back(self, time: float) -> float:
        """Return the speed commanded at the same place of the reversed motion."""
        if self.ramp is None or not self.leg.travels:
            return 0.0
        return self.leg.speed if time > self.ramp.cruise_begins else self.ramp.start


class Course:
    """Legs driven one after the other, with constant-acceleration ramps between speeds.

    Args:
        after: what follows the last leg: ``stay``, ``repeat`` the course from where it ended, or
            ``back``, the whole motion in reverse and so on, to and fro.
        acceleration: m/s^2. angular_acceleration: rad/s^2.

    Raises:
        ScenarioError: there is no leg, or one is too short for its speeds.
    """

    def __init__(
        self,
        x: float,
        y: float,
        heading: float,
        legs: Sequence[Leg],
        *,
        after: str,
        acceleration: float,
        angular_acceleration: float,
    ) -> None:
        if not legs:
            raise ScenarioError("a course needs at least one leg")
        self._after = after
        self._timed: list[_TimedLeg] = []
        now, start = 0.0, PlanarState(x, y, heading)
        for k, leg in enumerate(legs):
            ramp: Ramp | None = None
            if leg.travels:
                ramp = Ramp.over(
                    abs(leg.distance),
                    self._speed_between(legs, k - 1, k),
                    leg.speed,
                    self._speed_between(legs, k, k + 1),
                    acceleration,
                )
            elif leg.angle:
                ramp = Ramp.over(abs(leg.angle), 0.0, leg.rate, 0.0, angular_acceleration)
            duration = leg.seconds if ramp is None else ramp.duration
            timed = _TimedLeg(leg, ramp, now, duration, start)
            self._timed.append(timed)
            end = timed.state(duration)
            start = PlanarState(end.x, end.y, end.heading)
            now += duration
        self.period = now
        self._begins = [t.begins for t in self._timed]

    def _speed_between(self, legs: Sequence[Leg], before: int, after: int) -> float:
        """Return the speed at the joint of two legs, 0 unless both travel in the same direction.

        It is the first leg's speed; a slower second leg brakes at its beginning.
        """
        if self._after == "repeat":
            before, after = before % len(legs), after % len(legs)
        elif before < 0 or after >= len(legs):
            return 0.0
        first, second = legs[before], legs[after]
        if not (first.travels and second.travels and first.distance * second.distance > 0):
            return 0.0
        return first.speed

    def _find(self, time: float) -> tuple[_TimedLeg, float]:
        k = max(0, bisect_right(self._begins, time) - 1)
        leg = self._timed[k]
        return leg, min(time - leg.begins, leg.duration)

    def _once(self, time: float) -> PlanarState:
        leg, since = self._find(time)
        return leg.state(since)

    def state(self, time: float) -> PlanarState:
        time = max(0.0, time)
        if time < self.period:
            return self._once(time)
        if self._after == "stay":
            end = self._once(self.period)
            return PlanarState(end.x, end.y, end.heading)
        cycles, rest = divmod(time, self.period)
        if self._after == "back":
            if int(cycles) % 2 == 0:
                return self._once(rest)
            s = self._once(self.period - rest)
            return PlanarState(s.x, s.y, s.heading, -s.vx, -s.vy, -s.turn_rate)
        return self._repeated(int(cycles), self._once(rest))

    def _repeated(self, cycles: int, state: PlanarState) -> PlanarState:
        """Return a ``state`` of the first cycle moved on by ``cycles`` whole cycles."""
        start, end = self._timed[0].start, self._once(self.period)
        turn = end.heading - start.heading
        whole = math.remainder(turn, 2 * math.pi)
        closed = math.hypot(end.x - start.x, end.y - start.y) < _CLOSED_M
        if closed and abs(whole) < _CLOSED_M:
            return state
        for _ in range(cycles):
            # Apply to the state the transform that takes the course's start to its end.
            c, s = math.cos(turn), math.sin(turn)
            dx, dy = state.x - start.x, state.y - start.y
            state = PlanarState(
                end.x + c * dx - s * dy,
                end.y + s * dx + c * dy,
                state.heading + turn,
                c * state.vx - s * state.vy,
                s * state.vx + c * state.vy,
                state.turn_rate,
            )
        return state

    def commanded_speed(self, time: float) -> float:
        if self._after == "stay" and time >= self.period:
            return 0.0
        cycles, rest = divmod(max(0.0, time), self.period)
        if self._after == "back" and int(cycles) % 2 == 1:
            leg, since = self._find(self.period - rest)
            return leg.commanded_speed_back(since)
        leg, since = self._find(rest)
        return leg.commanded_speed(since)
