"""Vehicles of a simulated world that follow their script until they are driven."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace

from observer.robots.models import RobotSpec
from observer.simulation.motion import PlanarMotion, PlanarState, state_on_arc
from observer.simulation.robots.chassis import Drive, Wheels
from observer.simulation.robots.floor import Outline, Surroundings, outline_at
from observer.simulation.robots.sonar import sonar_range
from observer.simulation.robots.vehicle import Vehicle

# Physics steps that are kept, 10 ms each: a frame needs its own time and those around it
# (exposure, shutter, skew).
_KEPT = 1000
# Seconds: longest extrapolation beyond the newest step.
_AHEAD_S = 0.25


@dataclass(frozen=True)
class _Step:
    time: float
    state: PlanarState
    commanded: float


class Driven:
    """A motion that follows a script, and from ``begin`` on what was really driven.

    Args:
        lock: shared with the writer.
    """

    def __init__(self, script: PlanarMotion, lock: threading.RLock) -> None:
        self.script = script
        self._lock = lock
        self._steps: deque[_Step] = deque(maxlen=_KEPT)
        self._since: float | None = None

    @property
    def started(self) -> bool:
        """True while it is driven."""
        return self._since is not None

    def begin(self, time: float, state: PlanarState) -> None:
        """End the script at ``time``."""
        with self._lock:
            self._since = time
            self._steps.append(_Step(time, state, self.script.commanded_speed(time)))

    def add(self, time: float, state: PlanarState, commanded: float) -> None:
        """Append a step, later than the last one."""
        with self._lock:
            self._steps.append(_Step(time, state, commanded))

    def forget(self) -> None:
        """Return to the script."""
        with self._lock:
            self._since = None
            self._steps.clear()

    def state(self, time: float) -> PlanarState:
        """Interpolate between steps; extrapolate beyond the last one with its velocity."""
        with self._lock:
            if self._since is None or time <= self._since:
                return self.script.state(time)
            before, after = self._around(time)
        if after is None:
            return _onward(before.state, min(time - before.time, _AHEAD_S))
        share = (time - before.time) / (after.time - before.time)
        return _between(before.state, after.state, min(max(share, 0.0), 1.0))

    def commanded_speed(self, time: float) -> float:
        with self._lock:
            if self._since is None or time <= self._since:
                return self.script.commanded_speed(time)
            before, after = self._around(time)
        return (after or before).commanded

    def _around(self, time: float) -> tuple[_Step, _Step | None]:
        """Return the steps before and after ``time``; for earlier times the oldest two."""
        after: _Step | None = None
        before = self._steps[-1]
        for step in reversed(self._steps):
            before = step
            if step.time <= time:
                break
            after = step
        else:
            if len(self._steps) > 1:
                after = self._steps[1]
        return before, after


class DrivenVehicle:
    """One robot of a world; fulfils ``chassis.Chassis``.

    Time passes only through ``advance``. Every method takes the world's lock itself, except those
    for the world's own use below.

    Args:
        size: length and width of the rendered body, metres.
        script: its motion until its motors are enabled for the first time.
        clock: monotonic seconds. idle_s: after this long without ``advance`` the simulation
            counts as paused, and the wheels report that they stand.
    """

    def __init__(
        self,
        spec: RobotSpec,
        size: tuple[float, float],
        script: PlanarMotion,
        lock: threading.RLock,
        *,
        bumpers: int,
        seed: int,
        idle_s: float,
        clock: Callable[[], float],
    ) -> None:
        self.motion = Driven(script, lock)
        self.around: Callable[[], Surroundings] = Surroundings
        self._spec = spec
        self._size = size
        self._lock = lock
        self._clock = clock
        self._idle_s = idle_s
        self._vehicle = Vehicle(spec, size, script.state(0.0), bumpers=bumpers, seed=seed)
        self._time: float | None = None
        self._wanted = False
        self._switched_off = False
        self._advanced = -math.inf

    # ------------------------------------------------------------------ Chassis

    def drive(self, drive: Drive) -> None:
        with self._lock:
            if self._switched_off and drive.powered:
                # The firmware does not know yet that the power was cut.
                return
            self._switched_off = False
            self._vehicle.drive = drive
            self._wanted = self._wanted or drive.powered

    def wheels(self) -> Wheels:
        with self._lock:
            wheels = self._vehicle.wheels()
            if self._clock() - self._advanced > self._idle_s:
                wheels = replace(wheels, speed_mps=0.0, turn_rate_radps=0.0)
            return wheels

    def sonar(self, index: int) -> float | None:
        with self._lock:
            edges, state = self.around().edges(), self._vehicle.state
        return sonar_range(edges, state, self._spec.sonars[index])

    # ------------------------------------------------------------------ the world's own use

    @property
    def driven(self) -> bool:
        """True if it is or will be driven from the next frame on."""
        return self._wanted or self.motion.started

    @property
    def outline(self) -> Outline:
        """Its current outline; the lock is held."""
        return outline_at(self._vehicle.state, *self._size)

    def prepare(self, time: float) -> None:
        """Prepare for a step that begins at ``time``; the lock is held."""
        if self._time is None:
            self._vehicle.place(self.motion.script.state(time))
            self._time = time
        self._advanced = self._clock()
        if self._wanted and not self.motion.started:
            self.motion.begin(self._time, self._vehicle.state)

    def advance(self, time: float, around: Surroundings | None) -> None:
        """Step to ``time``; ``around`` is needed while it is driven. The lock is held."""
        if self._time is None or time <= self._time:
            return
        if self.motion.started and around is not None:
            self._vehicle.advance(time - self._time, around)
            drive = self._vehicle.drive
            self.motion.add(time, self._vehicle.state, abs(drive.speed_mps))
        else:
            self._vehicle.carry(self.motion.script.state(time))
        self._time = time

    def restart(self) -> None:
        """Return to the start of the script, motors off; the lock is held."""
        self.switch_off()
        self.motion.forget()
        self._wanted = False
        self._time = None
        self._vehicle.place(self.motion.script.state(0.0))

    def switch_off(self) -> None:
        """Cut the power until the firmware has switched its motors off itself. The lock is held."""
        self._switched_off = True
        self._vehicle.drive = Drive()


def _onward(state: PlanarState, seconds: float) -> PlanarState:
    """Extrapolate a state along an arc with its velocities."""
    c, s = math.cos(state.heading), math.sin(state.heading)
    speed = c * state.vx + s * state.vy
    turned = state.turn_rate * seconds
    return state_on_arc(state, speed * seconds, turned, speed, state.turn_rate)


def _between(a: PlanarState, b: PlanarState, share: float) -> PlanarState:
    return PlanarState(*(p + share * (q - p) for p, q in zip(astuple(a), astuple(b), strict=True)))
