"""Vehicle with two driven wheels: ramps, inertia, contact, and odometry errors.

It has no clock: time passes only through ``advance``, and equal calls give equal states.
"""

from __future__ import annotations

import math

import numpy as np

from observer.geometry import along_arc
from observer.robots.models import RobotSpec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.chassis import Drive, Wheels
from observer.simulation.robots.floor import Surroundings, outline_at

# Seconds: longest integration step, several times shorter than the lag below.
STEP_S = 0.01
# Seconds: the speed follows its ramp with a first-order lag (motors, wheels, mass).
_LAG_S = 0.08
# Deceleration without power, by the friction of gears and motors.
_FRICTION_MPS2, _FRICTION_RADPS2 = 1.5, 6.0
# Metres: a smaller overlap is mere contact.
_TOUCH_M = 1e-6
# Below these speeds a vehicle stands, if nothing is commanded.
_STILL_MPS, _STILL_RADPS = 1e-4, 1e-3
# Standard deviations of relative errors of wheels, drawn once: wheel size and track width.
SCALE_SIGMA = 0.01
TURN_SIGMA = 0.01
# Slip, rad per square root of a metre driven.
_SLIP = 0.003


class Vehicle:
    """One vehicle on a floor.

    Args:
        spec: its model. size: length and width about the axle's middle, metres.
        state: pose and velocity at the start.
        bumpers: number at each end, spread from right to left.
        seed: of its odometry errors; None for exact wheels.
    """

    def __init__(
        self,
        spec: RobotSpec,
        size: tuple[float, float],
        state: PlanarState,
        *,
        bumpers: int = 0,
        seed: int | None = None,
    ) -> None:
        self._size = size
        self._bumpers = (1 << bumpers) - 1
        self.drive = Drive()
        # Metres: half the track width, from the model's own conversion factor.
        self._half_track = 1 / (1000 * spec.wheel_turn)
        self._rng = np.random.default_rng(np.random.SeedSequence([seed or 0, 0xD21]))
        drifts = seed is not None
        self._scale = 1 + drifts * SCALE_SIGMA * float(self._rng.standard_normal())
        self._turn = 1 + drifts * TURN_SIGMA * float(self._rng.standard_normal())
        self._slip = _SLIP if drifts else 0.0
        self._wheel_x = self._wheel_y = self._wheel_yaw = 0.0
        self._left = self._right = 0.0
        self.place(state)

    def place(self, state: PlanarState) -> None:
        """Set its state, moving along its heading; the odometry ignores the jump."""
        self._x, self._y, self._heading = state.x, state.y, state.heading
        along = math.cos(state.heading) * state.vx + math.sin(state.heading) * state.vy
        self._speed = self._asked = along
        self._rate = self._asked_rate = state.turn_rate
        self._blocked = False
        self._touched = (0, 0)

    def carry(self, state: PlanarState) -> None:
        """Move it to ``state`` from outside, with its wheels rolling on the floor."""
        dx, dy = state.x - self._x, state.y - self._y
        c, s = math.cos(self._heading), math.sin(self._heading)
        turned = math.remainder(state.heading - self._heading, 2 * math.pi)
        self._count(c * dx + s * dy, turned)
        self.place(state)

    @property
    def state(self) -> PlanarState:
        """True pose and velocity."""
        c, s = math.cos(self._heading), math.sin(self._heading)
        return PlanarState(
            self._x, self._y, self._heading, c * self._speed, s * self._speed, self._rate
        )

    def wheels(self) -> Wheels:
        """Return what its encoders and switches measure."""
        drive = self.drive
        left = drive.speed_mps - self._half_track * drive.turn_rate_radps
        right = drive.speed_mps + self._half_track * drive.turn_rate_radps
        pushes = self._blocked and drive.powered
        return Wheels(
            *(self._wheel_x, self._wheel_y, self._wheel_yaw, self._left, self._right),
            *(self._speed * self._scale, self._rate * self._turn),
            (pushes and left != 0, pushes and right != 0),
            *self._touched,
        )

    def advance(self, seconds: float, around: Surroundings) -> None:
        """Let time pass while its surroundings stand still."""
        if seconds <= 0:
            return
        steps = max(1, math.ceil(seconds / STEP_S - 1e-9))
        for _ in range(steps):
            self._step(seconds / steps, around)

    def _step(self, h: float, around: Surroundings) -> None:
        d = self.drive
        if d.powered:
            up, down = d.acceleration_mps2 * h, d.deceleration_mps2 * h
            self._asked = _ramped(self._asked, d.speed_mps, up, down)
            up, down = d.turn_acceleration_radps2 * h, d.turn_deceleration_radps2 * h
            self._asked_rate = _ramped(self._asked_rate, d.turn_rate_radps, up, down)
        else:
            self._asked = _ramped(self._asked, 0.0, 0.0, _FRICTION_MPS2 * h)
            self._asked_rate = _ramped(self._asked_rate, 0.0, 0.0, _FRICTION_RADPS2 * h)
        follow = 1 - math.exp(-h / _LAG_S)
        before = self._speed, self._rate
        self._speed += follow * (self._asked - self._speed)
        self._rate += follow * (self._asked_rate - self._rate)
        if self._asked == 0 and abs(self._speed) < _STILL_MPS:
            self._speed = 0.0
        if self._asked_rate == 0 and abs(self._rate) < _STILL_RADPS:
            self._rate = 0.0
        self._go((before[0] + self._speed) / 2 * h, (before[1] + self._rate) / 2 * h, around)

    def _go(self, distance: float, turned: float, around: Surroundings) -> None:
        """Move along an arc, unless something is in the way."""
        if distance == 0 and turned == 0:
            self._blocked = False
            return
        x, y = along_arc(self._x, self._y, self._heading, distance, turned)
        new = PlanarState(x, y, self._heading + turned)
        depth = around.depth(outline_at(new, *self._size))
        # It may move out of something that it already overlaps.
        if depth > _TOUCH_M and depth >= around.depth(outline_at(self.state, *self._size)):
            self._blocked = True
            # All bumpers at the pushing end, wherever the contact is.
            self._touched = (self._bumpers * (distance > 0), self._bumpers * (distance < 0))
            self._speed = self._rate = self._asked = self._asked_rate = 0.0
            return
        self._blocked = False
        self._touched = (0, 0)
        self._x, self._y, self._heading = new.x, new.y, new.heading
        self._count(distance, turned)

    def _count(self, distance: float, turned: float) -> None:
        """Add one step to the odometry, with its errors."""
        if distance == 0 and turned == 0:
            return
        distance, turned = distance * self._scale, turned * self._turn
        if self._slip:
            turned += self._slip * math.sqrt(abs(distance)) * float(self._rng.standard_normal())
        self._wheel_x, self._wheel_y = along_arc(
            self._wheel_x, self._wheel_y, self._wheel_yaw, distance, turned
        )
        self._wheel_yaw += turned
        self._left += distance - self._half_track * turned
        self._right += distance + self._half_track * turned


def _ramped(value: float, goal: float, up: float, down: float) -> float:
    """Make one step of a ramp towards ``goal``: ``up`` away from zero, ``down`` towards it."""
    if value * goal < 0:
        # Go through zero first.
        goal = 0.0
    step = up if abs(goal) > abs(value) else down
    return goal if abs(goal - value) <= step else value + math.copysign(step, goal - value)
