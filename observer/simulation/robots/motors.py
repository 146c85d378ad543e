"""Motion control of a firmware: setpoints, limits, watchdog, stalls, goals."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from observer.robots.arcos import Command
from observer.robots.models import RobotSpec
from observer.simulation.robots.chassis import Chassis, Drive, Wheels
from observer.simulation.robots.faults import Faults

VELOCITIES = (Command.VEL, Command.RVEL, Command.VEL2)
_MOTIONS = (*VELOCITIES, Command.MOVE, Command.HEAD, Command.DHEAD)
# Seconds: the motors relax for this long after a stall; CONFIG reports it in units of 5 ms.
STALL_WAIT_S = 1.0
# Seconds: then they push for this long before the next stall counts.
_PUSH_S = 0.1
# Hardest braking of the machine: E_STOP overrides the requested deceleration.
HARDEST_MPS2, HARDEST_RADPS2 = 5.0, 20.0
# Tolerances and approach rate of MOVE, HEAD and DHEAD.
_NEAR_M, _NEAR_RAD = 0.005, math.radians(0.5)
_APPROACH_PER_S = 4.0


@dataclass
class Setpoint:
    """The motion requested last; it survives the watchdog.

    Attributes:
        speed, turn_rate: m/s and rad/s. wheels: requested by VEL2.
        distance_goal, heading_goal: in the encoders' running totals, m and rad; None without one.
        hard: brake as hard as possible.
    """

    speed: float = 0.0
    turn_rate: float = 0.0
    wheels: bool = False
    distance_goal: float | None = None
    heading_goal: float | None = None
    hard: bool = False


@dataclass
class MotionLimits:
    """Limits that SETV, SETRV, SETA and SETRA change; m/s, rad/s and per second."""

    speed: float
    turn_rate: float
    acceleration: float = 0.3
    deceleration: float = 0.3
    turn_acceleration: float = math.radians(100)
    turn_deceleration: float = math.radians(100)


class Motors:
    """Motion control of a firmware, on the firmware's time.

    Args:
        bumpers: number at each end.

    Attributes:
        setpoint, limits: the current ones.
        timed_out: the watchdog stopped the robot and no command has come since.
        bump_stall: bit 0, a front bumper stalls the motors; bit 1, a rear one.
    """

    def __init__(
        self,
        spec: RobotSpec,
        chassis: Chassis,
        faults: Faults,
        bumpers: int,
        watchdog_s: float,
        now: float,
    ) -> None:
        self.setpoint = Setpoint()
        self.limits = MotionLimits(spec.speed_max_mps, spec.turn_rate_max_radps)
        self.timed_out = False
        self.bump_stall = 0
        self._spec = spec
        self._chassis = chassis
        self._faults = faults
        self._bumpers = (1 << bumpers) - 1
        self._watchdog_s = watchdog_s
        self._on = False
        self._now = self._commanded = now
        self._relaxed_until = -math.inf
        self._stall = (False, False)

    @property
    def on(self) -> bool:
        """True while the motors have power."""
        return self._on and not self._faults.stop_pressed

    def switch(self, *, on: bool) -> None:
        """Switch the motors on or off; switching off clears the setpoint."""
        self._on = on and not self._faults.stop_pressed
        if not on:
            self.setpoint = Setpoint()
        self._drive()

    def commanded(self, now: float) -> None:
        """Note a command of any kind: it ends a time-out and re-activates the last setpoint."""
        self._now = self._commanded = now
        self.timed_out = False
        self._drive()

    def stop(self, *, hard: bool) -> None:
        """Obey STOP, or E_STOP if ``hard``."""
        self.setpoint = Setpoint(hard=hard)
        self._drive()

    def limit(self, number: int, value: int) -> None:
        """Obey SETA, SETRA, SETV and SETRV; 0 changes nothing."""
        limits, spec = self.limits, self._spec
        if number == Command.SETV and value > 0:
            limits.speed = min(value / 1000, spec.speed_max_mps)
        elif number == Command.SETRV and value > 0:
            limits.turn_rate = min(math.radians(value), spec.turn_rate_max_radps)
        elif number == Command.SETA and value:
            name = "acceleration" if value > 0 else "deceleration"
            setattr(limits, name, abs(value) / 1000)
        elif number == Command.SETRA and value:
            name = "turn_acceleration" if value > 0 else "turn_deceleration"
            setattr(limits, name, math.radians(abs(value)))
        self._drive()

    def asked(self, number: int, value: int) -> tuple[float, float]:
        """Return the velocity that a command asks for, before limits; m/s and rad/s."""
        if number == Command.VEL:
            return value / 1000, 0.0
        if number == Command.RVEL:
            return 0.0, math.radians(value)
        left, right = struct.unpack(">bb", struct.pack(">H", value & 0xFFFF))
        return (left + right) / 2 * 0.02, (right - left) / 2 * 20 * self._spec.wheel_turn

    def move(self, number: int, value: int, heading: float) -> None:
        """Obey a command that moves the robot, if the motors are on.

        Args:
            heading: the robot's, by its own odometry, rad; used by HEAD.
        """
        if not self.on or number not in _MOTIONS:
            return
        point, limits, wheels = self.setpoint, self.limits, self._chassis.wheels()
        # A hard stop lasts until the robot is commanded to move.
        point.hard = point.hard and value == 0
        if point.wheels or number == Command.VEL2:
            # Wheel velocities and VEL or RVEL exclude each other: the last one wins.
            point = self.setpoint = Setpoint(hard=point.hard)
        if number == Command.VEL2:
            speed, turn_rate = self.asked(number, value)
            point.speed = _bounded(speed, limits.speed)
            point.turn_rate = _bounded(turn_rate, limits.turn_rate)
            point.wheels = True
        elif number == Command.VEL:
            point.speed, point.distance_goal = _bounded(value / 1000, limits.speed), None
        elif number == Command.RVEL:
            rate = _bounded(math.radians(value), limits.turn_rate)
            point.turn_rate, point.heading_goal = rate, None
        elif number == Command.MOVE:
            point.distance_goal = _driven_m(wheels) + value / 1000
        elif number == Command.HEAD:
            turn = math.remainder(math.radians(value) - heading, 2 * math.pi)
            point.heading_goal = wheels.yaw + turn
        else:
            point.heading_goal = wheels.yaw + math.radians(value)
        self._drive()

    # ------------------------------------------------------------------ without a command

    def watch(self, now: float) -> None:
        """Update what changes without a command: watchdog, stalls, goals."""
        self._now = now
        wheels = self._chassis.wheels()
        if self._watchdog_s and now - self._commanded > self._watchdog_s:
            self.timed_out = True
        if self._faults.stop_pressed and self._on:
            self.switch(on=False)
        front, rear = self.touched(wheels)
        bumped = (self.bump_stall & 1 and front) or (self.bump_stall & 2 and rear)
        if now >= self._relaxed_until:
            self._stall = self._pushed(wheels)
            # The motors relax for a while, then push again by themselves.
            if (any(self._stall) or bumped) and now >= self._relaxed_until + _PUSH_S:
                self._relaxed_until = now + STALL_WAIT_S
        self._approach(wheels)
        self._drive()

    def stalled(self, wheels: Wheels) -> tuple[bool, bool]:
        """Return the stalls left and right; while the motors relax, the last ones persist."""
        return self._stall if self._now < self._relaxed_until else self._pushed(wheels)

    def touched(self, wheels: Wheels) -> tuple[int, int]:
        """Return the bits of the pressed front and rear bumpers."""
        return (
            (wheels.front_bumpers | self._faults.front_bumpers) & self._bumpers,
            (wheels.rear_bumpers | self._faults.rear_bumpers) & self._bumpers,
        )

    def _pushed(self, wheels: Wheels) -> tuple[bool, bool]:
        forced = self._faults.stalled
        return wheels.stalled[0] or forced[0], wheels.stalled[1] or forced[1]

    def _approach(self, wheels: Wheels) -> None:
        """Drive towards the goals of MOVE, HEAD and DHEAD, slowly enough to stop there."""
        point, limits = self.setpoint, self.limits
        if point.distance_goal is not None:
            rest = point.distance_goal - _driven_m(wheels)
            if abs(rest) < _NEAR_M:
                point.distance_goal, point.speed = None, 0.0
            else:
                point.speed = _approach_speed(rest, limits.deceleration, limits.speed)
        if point.heading_goal is not None:
            rest = point.heading_goal - wheels.yaw
            if abs(rest) < _NEAR_RAD:
                point.heading_goal, point.turn_rate = None, 0.0
            else:
                point.turn_rate = _approach_speed(rest, limits.turn_deceleration, limits.turn_rate)

    def _drive(self) -> None:
        """Send the machine the current command."""
        point, limits = self.setpoint, self.limits
        moves = self.on and not self.timed_out and self._now >= self._relaxed_until
        self._chassis.drive(
            Drive(
                point.speed if moves else 0.0,
                point.turn_rate if moves else 0.0,
                limits.acceleration,
                HARDEST_MPS2 if point.hard else limits.deceleration,
                limits.turn_acceleration,
                HARDEST_RADPS2 if point.hard else limits.turn_deceleration,
                powered=self.on,
            )
        )


def _approach_speed(rest: float, deceleration: float, limit: float) -> float:
    fast = min(limit, math.sqrt(deceleration * abs(rest)), abs(rest) * _APPROACH_PER_S)
    return math.copysign(fast, rest)


def _driven_m(wheels: Wheels) -> float:
    return (wheels.left_m + wheels.right_m) / 2


def _bounded(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
