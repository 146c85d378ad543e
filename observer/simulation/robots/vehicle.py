"""A vehicle with two driven wheels: ramps, inertia, contact, and wheels that count with errors.

It knows no clock: time passes by ``advance`` only, and equal calls give equal states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import along_arc
from observer.robots.models import RobotSpec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.chassis import Drive, Wheels
from observer.simulation.robots.floor import Surroundings, outline_at

# Longest step of the integration; the lag below is several of them.
STEP_S = 0.01
# The speed follows its ramp as a first-order lag: motors, wheels and the mass of the machine.
_LAG_S = 0.08
# Without power the wheels run out against gears and motors.
_FRICTION_MPS2, _FRICTION_RADPS2 = 1.5, 6.0
# What is overlapped less than this counts as touched only.
_TOUCH_M = 1e-6
# Standing, where nothing is asked for.
_STILL_MPS, _STILL_RADPS = 1e-4, 1e-3
# One standard deviation, drawn once, as in ``observer.simulation.odometry``: of the wheels' size
# and of their distance; and slip, rad per square root of a metre of way.
_SCALE_SIGMA = 0.01
_TURN_SIGMA = 0.01
_SLIP = 0.003


@dataclass(frozen=True)
class Hull:
    """A vehicle's outline and bumpers.

    Attributes:
        length_m, width_m: of the outline about the axle's middle.
        front_bumpers, rear_bumpers: how many are fitted, spread over that end from right to
            left; none where 0.
    """

    length_m: float
    width_m: float
    front_bumpers: int = 0
    rear_bumpers: int = 0


class Vehicle:
    """One vehicle on a floor.

    Args:
        spec: its model: wheels. hull: its outline.
        state: where it is and how it moves at the start.
        seed: of its wheels' errors; None for wheels that count exactly.
    """

    def __init__(
        self, spec: RobotSpec, hull: Hull, state: PlanarState, *, seed: int | None = None
    ) -> None:
        self.hull = hull
        self.drive = Drive()
        # Of the wheels from each other, by the factor that the model itself uses.
        self._half_track = 1 / (1000 * spec.wheel_turn)
        self._rng = np.random.default_rng(np.random.SeedSequence([seed or 0, 0xD21]))
        drifts = seed is not None
        self._scale = 1 + drifts * _SCALE_SIGMA * float(self._rng.standard_normal())
        self._turn = 1 + drifts * _TURN_SIGMA * float(self._rng.standard_normal())
        self._slip = _SLIP if drifts else 0.0
        self._wheel_x = self._wheel_y = self._wheel_yaw = 0.0
        self._left = self._right = 0.0
        self.place(state)

    def place(self, state: PlanarState) -> None:
        """Put it somewhere, moving along its heading as told; its wheels count nothing of it."""
        self._x, self._y, self._heading = state.x, state.y, state.heading
        along = math.cos(state.heading) * state.vx + math.sin(state.heading) * state.vy
        self._speed = self._asked = along
        self._rate = self._asked_rate = state.turn_rate
        self._blocked = False
        self._touched = (0, 0)

    def carry(self, state: PlanarState) -> None:
        """It was moved to ``state`` by something else, its wheels on the floor."""
        dx, dy = state.x - self._x, state.y - self._y
        c, s = math.cos(self._heading), math.sin(self._heading)
        turned = math.remainder(state.heading - self._heading, 2 * math.pi)
        self._count(c * dx + s * dy, turned)
        self.place(state)

    @property
    def state(self) -> PlanarState:
        """Where it truly is and how it truly moves."""
        c, s = math.cos(self._heading), math.sin(self._heading)
        return PlanarState(
            self._x, self._y, self._heading, c * self._speed, s * self._speed, self._rate
        )

    @property
    def speed_mps(self) -> float:
        """True, along the heading."""
        return self._speed

    def wheels(self) -> Wheels:
        """What its encoders and switches tell."""
        drive = self.drive
        left = drive.speed_mps - self._half_track * drive.turn_rate_radps
        right = drive.speed_mps + self._half_track * drive.turn_rate_radps
        pushes = self._blocked and drive.powered
        return Wheels(
            self._wheel_x, self._wheel_y, self._wheel_yaw, self._left, self._right,
            self._speed * self._scale, self._rate * self._turn,
            (pushes and left != 0, pushes and right != 0), *self._touched,
        )  # fmt: skip

    def advance(self, seconds: float, around: Surroundings) -> None:
        """Let time pass; what is around it stands meanwhile."""
        if seconds <= 0:
            return
        steps = max(1, math.ceil(seconds / STEP_S - 1e-9))
        for _ in range(steps):
            self._step(seconds / steps, around)

    def _step(self, h: float, around: Surroundings) -> None:
        d = self.drive
        if d.powered:
            self._asked = _ramped(
                self._asked, d.speed_mps, d.acceleration_mps2 * h, d.deceleration_mps2 * h
            )
            self._asked_rate = _ramped(
                self._asked_rate, d.turn_rate_radps, d.turn_acceleration_radps2 * h,
                d.turn_deceleration_radps2 * h,
            )  # fmt: skip
        else:
            self._asked = _ramped(self._asked, 0.0, _FRICTION_MPS2 * h, _FRICTION_MPS2 * h)
            brake = _FRICTION_RADPS2 * h
            self._asked_rate = _ramped(self._asked_rate, 0.0, brake, brake)
        follow = 1 - math.exp(-h / _LAG_S)
        before = self._speed, self._rate
        self._speed += follow * (self._asked - self._speed)
        self._rate += follow * (self._asked_rate - self._rate)
        if self._asked == 0 and abs(self._speed) < _STILL_MPS:
            self._speed = 0.0
        if self._asked_rate == 0 and abs(self._rate) < _STILL_RADPS:
            self._rate = 0.0
        self._go((before[0] + self._speed) / 2 * h, (before[1] + self._rate) / 2 * h, around)

    def _go(self, way: float, turned: float, around: Surroundings) -> None:
        """Along an arc, unless something is in the way."""
        if way == 0 and turned == 0:
            self._blocked = False
            return
        x, y = along_arc(self._x, self._y, self._heading, way, turned)
        new = PlanarState(x, y, self._heading + turned)
        size = self.hull.length_m, self.hull.width_m
        depth = around.depth(outline_at(new, *size))
        # Out of something that came over it, it may leave.
        if depth > _TOUCH_M and depth >= around.depth(outline_at(self.state, *size)):
            self._blocked = True
            self._touched = self._bumpers(way, turned)
            self._speed = self._rate = self._asked = self._asked_rate = 0.0
            return
        self._blocked = False
        self._touched = (0, 0)
        self._x, self._y, self._heading = new.x, new.y, new.heading
        self._count(way, turned)

    def _count(self, way: float, turned: float) -> None:
        """The wheels' sums of one step, with their errors."""
        if way == 0 and turned == 0:
            return
        way, turned = way * self._scale, turned * self._turn
        if self._slip:
            turned += self._slip * math.sqrt(abs(way)) * float(self._rng.standard_normal())
        self._wheel_x, self._wheel_y = along_arc(
            self._wheel_x, self._wheel_y, self._wheel_yaw, way, turned
        )
        self._wheel_yaw += turned
        self._left += way - self._half_track * turned
        self._right += way + self._half_track * turned

    def _bumpers(self, way: float, turned: float) -> tuple[int, int]:
        """Front and rear bumpers that are pressed by what it runs into: bits.

        All bumpers of the end that pushes, without a look at where it touches.
        """
        front, rear = self.hull.front_bumpers, self.hull.rear_bumpers
        if way == 0 and turned != 0:
            return 0, 0
        return ((1 << front) - 1, 0) if way > 0 else (0, (1 << rear) - 1)


def _ramped(value: float, goal: float, up: float, down: float) -> float:
    """One step of a ramp towards ``goal``: ``up`` away from zero, ``down`` towards it."""
    if value * goal < 0:
        # Through zero first.
        goal = 0.0
    step = up if abs(goal) > abs(value) else down
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)
