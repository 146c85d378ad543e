"""Contract of a robot with the drive loop: it takes velocities and reports its state.

A robot owns its port and the threads that wait for it. Every method here returns at once,
whatever the port does, and is called from one thread (the drive loop); ``report`` from any.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, Protocol, runtime_checkable

from observer.rig.rig import Role
from observer.types import Odometry

# The port's own thread replaces a velocity that is not repeated within this time with zero, so
# that the robot stops if the drive loop hangs.
SETPOINT_FRESH_S = 0.15
# Highest age of the newest report of a robot that may move. Robots report every 0.1 s or more
# often, so that one report may be lost or late.
REPORT_FRESH_S = 0.3


class RobotPhase(StrEnum):
    """State of the connection."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    # The connection was lost or never made; it is retried automatically.
    WAITING = "waiting"
    # Not retried: the cause does not go away by itself (e.g. an unknown robot).
    REFUSED = "refused"
    CLOSED = "closed"


@dataclass(frozen=True)
class RobotLimits:
    """Highest values the robot accepts: m/s, rad/s, m/s^2, rad/s^2; all positive."""

    speed_mps: float
    turn_rate_radps: float
    acceleration_mps2: float
    turn_acceleration_radps2: float


@dataclass(frozen=True)
class Sent:
    """A velocity that was actually sent.

    Attributes:
        speed_mps: forward. turn_rate_radps: positive to the left.
        time: the host's monotonic clock when it was handed to the port.
    """

    speed_mps: float
    turn_rate_radps: float
    time: float


@dataclass(frozen=True)
class SonarReading:
    """One sonar's newest echo.

    Attributes:
        index: its number. x, y, heading: of the sonar in the base frame, metres and radians.
        range_m: from the sonar to the nearest surface in its cone; None without an echo within
            its range.
        received: the host's monotonic clock.
    """

    index: int
    x: float
    y: float
    heading: float
    range_m: float | None
    received: float


BatteryLevel = Literal["good", "low", "critical"]
# Names of a report's counters.
COUNTERS = ("packets", "bad_packets", "unknown_packets", "reconnects", "odometry_jumps")


@dataclass(frozen=True)
class RobotReport:
    """Current state of a robot. None where the robot does not report a value.

    Attributes:
        phase: of the connection. trouble: one sentence on what is wrong with it, None while
            nothing is.
        fault: one sentence on an event that forbids motion (a stall, a bumper, silence, a lost
            port, motors that switched off by themselves); it stays until ``clear``.
        warnings: sentences that do not forbid motion (an old packet, a weak battery).
        received: when the newest status packet came, host's monotonic clock.
        name, model, subtype: name and subtype as the robot reports them; the model it is driven as.
        odometry: accumulated since it was connected, in host floats.
        speed_mps, turn_rate_radps: by its encoders.
        motors_enabled: as the robot reports.
        stalled: left and right wheel. front_bumpers, rear_bumpers: pressed or not; empty where
            none are fitted. stop_pressed: its own hardware button.
        battery_v: averaged. battery: its rating. charging: in words.
        sonars: those it has, in order; a reading keeps its time. Outdated from the beginning where
            one is fitted but has not reported yet.
        watchdog_s: time without a command after which its firmware stops it, as it reports; 0 if
            it never does.
        limits: those that apply, the lowest of all known limits.
        sent: the newest velocity that was actually sent.
        wanted: speed (m/s) and turn rate (rad/s) for which a robot that drives by itself asks
            permission; None for one that is only driven.
        radius_m, width_m, length_m: its outline.
        counters: by the names in ``COUNTERS``; ``odometry_jumps``: how often its own odometry
            changed more than it can have moved.
    """

    phase: RobotPhase
    trouble: str | None = None
    fault: str | None = None
    warnings: tuple[str, ...] = ()
    received: float | None = None
    name: str | None = None
    model: str | None = None
    subtype: str | None = None
    odometry: Odometry | None = None
    speed_mps: float | None = None
    turn_rate_radps: float | None = None
    motors_enabled: bool | None = None
    stalled: tuple[bool, bool] | None = None
    front_bumpers: tuple[bool, ...] = ()
    rear_bumpers: tuple[bool, ...] = ()
    stop_pressed: bool | None = None
    battery_v: float | None = None
    battery: BatteryLevel | None = None
    charging: str | None = None
    temperature_c: float | None = None
    sonars: tuple[SonarReading, ...] = ()
    watchdog_s: float | None = None
    limits: RobotLimits | None = None
    sent: Sent | None = None
    wanted: tuple[float, float] | None = None
    radius_m: float | None = None
    width_m: float | None = None
    length_m: float | None = None
    counters: Mapping[str, int] = field(default_factory=dict)


class Robot(Protocol):
    """A robot; see the module. It connects by itself once constructed, with motors off."""

    def report(self) -> RobotReport:
        """Return the robot's current state; callable from any thread."""
        ...

    def enable(self) -> None:
        """Switch the motors on, at zero velocity. Nothing else ever switches them on."""
        ...

    def disable(self) -> None:
        """Command zero velocity and switch the motors off."""
        ...

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Take this velocity until the next one, for ``SETPOINT_FRESH_S`` at most.

        Args:
            speed_mps, turn_rate_radps: finite; anything else counts as zero.

        Returns:
            The velocity as clamped and sent; zero while the robot has a fault, is not connected or
            has its motors off.
        """
        ...

    def stop(self) -> None:
        """Stop as hard as it can (overriding its deceleration), zero velocity, motors off."""
        ...

    def clear(self) -> None:
        """Clear the fault if its cause is gone; motors stay off."""
        ...

    def close(self) -> None:
        """Stop, motors off, end the session, release the port; waits for at most 2 s.

        Safe to call twice.
        """
        ...


@runtime_checkable
class Explained(Protocol):
    """A robot that also accepts the reason why it may not drive as requested."""

    def explain(self, reason: str | None) -> None:
        """Take one sentence, valid until the next; None if nothing limits the robot."""
        ...


@dataclass(frozen=True)
class RobotPort:
    """A robot that belongs to a source's own world, e.g. a simulated one.

    Attributes:
        role: which of the two. port: as ``observer.robot_opening.open_robot`` takes it.
        model: of ``observer.robots.models``. name: shown to people.
    """

    role: Role
    port: str
    model: str
    name: str


class RobotWorld(Protocol):
    """The robots that belong to a source's own world; nothing runs until ``serve``."""

    @property
    def world(self) -> str:
        """Name of the world, unique, as in ``observer.guard.sight.Sight.world``."""
        ...

    def serve(self) -> tuple[RobotPort, ...]:
        """Make the robots reachable and return where; a second call returns the same."""
        ...

    def close(self) -> None:
        """Remove the robots; safe to call twice."""
        ...
