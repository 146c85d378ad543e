"""A P3-DX of a CoppeliaSim scene as a robot that is driven.

A thread of its own holds a conversation of its own with the simulator, so that no call here ever
waits for it. The simulator has no watchdog: if this process is killed, the wheels keep the speed
that they had for as long as somebody lets the simulated time go on.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from observer.coppeliasim.address import Address, parse_robot
from observer.coppeliasim.connection import Connection, CoppeliaSimError, CoppeliaSimUnreachable
from observer.coppeliasim.odometry import WheelOdometry
from observer.coppeliasim.pioneers import MODEL, Pioneer, find_pioneer, own_scripts
from observer.coppeliasim.poses import number
from observer.coppeliasim.sonar import Sonar, find_sonars, read_sonar
from observer.errors import InputError
from observer.robots.contract import (
    SETPOINT_FRESH_S,
    RobotLimits,
    RobotPhase,
    RobotReport,
    Sent,
    SonarReading,
)
from observer.robots.models import robot_spec

_PERIOD_S = 0.05
# All of a ring's sensors are read within a quarter of a second.
_SONARS_A_TIME = 4
_RETRY_S = 1.0
_CLOSE_WITHIN_S = 2.0
# What the model takes without its wheels slipping or its body nodding.
_ACCELERATION_MPS2 = 1.0
_TURN_ACCELERATION_RADPS2 = math.radians(180)
_STOP = (0.0, 0.0)


def open_coppelia_robot(
    spec: str, model: str | None = None, *, clock: Callable[[], float] = time.monotonic
) -> CoppeliaSimRobot:
    """The robot ``coppeliasim:HOST:PORT/PATH``; returns at once and connects by itself.

    Raises:
        InputError: the text names no robot, or another model than a P3-DX.
    """
    address, path = parse_robot(spec)
    if model not in (None, MODEL, "p3dx"):
        raise InputError(f"robots of CoppeliaSim are driven as {MODEL}, not as {model}")
    return CoppeliaSimRobot(address, path, clock)


@dataclass(frozen=True)
class _Setpoint:
    """A velocity, and until when it holds."""

    speed_mps: float
    turn_rate_radps: float
    until: float


class CoppeliaSimRobot:
    """Fulfils ``observer.robots.contract.Robot``."""

    def __init__(
        self, address: Address, path: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._address, self._path = address, path
        self._clock = clock
        spec = robot_spec(MODEL)
        self._limits = RobotLimits(
            spec.speed_max_mps,
            spec.turn_rate_max_radps,
            _ACCELERATION_MPS2,
            _TURN_ACCELERATION_RADPS2,
        )
        self._condition = threading.Condition()
        self._enabled = False
        self._closing = False
        # Whether something was asked for that the thread has not seen.
        self._asked = False
        self._setpoint: _Setpoint | None = None
        self._report = RobotReport(
            RobotPhase.CONNECTING,
            model=MODEL,
            motors_enabled=False,
            limits=self._limits,
            radius_m=spec.radius_m,
            width_m=spec.width_m,
            length_m=spec.length_m,
            counters={"packets": 0, "reconnects": 0},
        )
        self._thread = threading.Thread(target=self._run, name=f"driving {path}", daemon=True)
        self._thread.start()

    def report(self) -> RobotReport:
        """How it is; from any thread."""
        with self._condition:
            return replace(self._report, motors_enabled=self._enabled)

    def enable(self) -> None:
        """Motors on, at zero velocity; not while it is not connected or has a fault."""
        with self._condition:
            self._setpoint = None
            self._enabled = (
                self._report.phase is RobotPhase.CONNECTED and self._report.fault is None
            )
            self._wake()

    def disable(self) -> None:
        """Zero velocity, motors off."""
        with self._condition:
            self._setpoint, self._enabled = None, False
            self._wake()

    def stop(self) -> None:
        """As ``disable``: the simulator's wheels stop as fast as they can either way."""
        self.disable()

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Take this velocity until the next one, for ``SETPOINT_FRESH_S`` at most."""
        limits = self._limits
        with self._condition:
            now = self._clock()
            if not self._enabled:
                return Sent(0.0, 0.0, now)
            speed = _within(speed_mps, limits.speed_mps)
            turn = _within(turn_rate_radps, limits.turn_rate_radps)
            self._setpoint = _Setpoint(speed, turn, now + SETPOINT_FRESH_S)
            self._wake()
            return Sent(speed, turn, now)

    def clear(self) -> None:
        """Forget the fault; motors stay off."""
        with self._condition:
            self._report = replace(self._report, fault=None)

    def close(self) -> None:
        """Stop, motors off, release the conversation; waits for at most 2 s."""
        with self._condition:
            self._closing = True
            self._setpoint, self._enabled = None, False
            self._wake()
        self._thread.join(_CLOSE_WITHIN_S)
        self._tell(phase=RobotPhase.CLOSED)

    # ------------------------------------------------------------------ the thread

    def _wake(self) -> None:
        self._asked = True
        self._condition.notify_all()

    def _run(self) -> None:
        try:
            while not self._closing:
                try:
                    _Drive(self).run()
                except CoppeliaSimError as error:
                    self._lost(str(error))
                with self._condition:
                    self._condition.wait_for(lambda: self._closing, _RETRY_S)
        finally:
            if not self._closing:
                # Something that nobody expected: it must not pass for connected.
                self._lost("its driver failed")
                self._tell(phase=RobotPhase.REFUSED)

    def _lost(self, sentence: str) -> None:
        with self._condition:
            before = self._report
            was_connected = before.phase is RobotPhase.CONNECTED
            self._setpoint, self._enabled = None, False
            self._report = replace(
                before,
                phase=RobotPhase.WAITING,
                trouble=sentence,
                fault=before.fault or (sentence if was_connected else None),
                speed_mps=None,
                turn_rate_radps=None,
                sonars=(),
                counters={
                    **before.counters,
                    "reconnects": before.counters["reconnects"] + was_connected,
                },
            )

    def _next_velocity(self) -> tuple[float, float] | None:
        """Waits until something is to be done; None where the robot is to be closed."""
        with self._condition:
            now, setpoint = self._clock(), self._setpoint
            wait = _PERIOD_S if setpoint is None else min(_PERIOD_S, setpoint.until - now)
            self._condition.wait_for(lambda: self._asked or self._closing, max(0.0, wait))
            self._asked = False
            if self._closing:
                return None
            setpoint = self._setpoint
            if setpoint is None or not self._enabled:
                return _STOP
            if self._clock() >= setpoint.until:
                self._setpoint = None
                return _STOP
            return setpoint.speed_mps, setpoint.turn_rate_radps

    def _tell(self, **facts: object) -> None:
        with self._condition:
            self._report = replace(self._report, **facts)  # type: ignore[arg-type]


class _Drive:
    """One conversation with the simulator about one robot, from connecting to its end."""

    def __init__(self, robot: CoppeliaSimRobot) -> None:
        self._robot = robot
        self._sonars: tuple[Sonar, ...] = ()
        self._readings: dict[int, SonarReading] = {}
        self._next_sonar = 0
        self._simulated: float | None = None
        self._packets = robot.report().counters["packets"]

    def run(self) -> None:
        """Until the robot is closed.

        Raises:
            CoppeliaSimError: the simulator cannot be reached, or has no such robot (any more).
        """
        connection = Connection(self._robot._address)
        try:
            pioneer = find_pioneer(connection, self._robot._path)
            # Whatever it was told before, it stands.
            self._write(connection, pioneer, _STOP)
            self._sonars = find_sonars(connection, pioneer)
            warnings = _warnings(connection, pioneer)
            odometry = WheelOdometry(pioneer.wheel_radius_m, pioneer.track_m)
            self._read(connection, pioneer, odometry, warnings)
            try:
                while (velocity := self._robot._next_velocity()) is not None:
                    self._write(connection, pioneer, velocity)
                    self._read(connection, pioneer, odometry, warnings)
            finally:
                # Nothing else stops its wheels; where nobody answers, nobody can be told.
                with contextlib.suppress(CoppeliaSimError):
                    self._write(connection, pioneer, _STOP)
        finally:
            connection.close()

    def _write(
        self, connection: Connection, pioneer: Pioneer, velocity: tuple[float, float]
    ) -> None:
        # Written every time: a simulation that was started anew has forgotten it.
        speed, turn = velocity
        half = turn * pioneer.track_m / 2
        for joint, wheel in ((pioneer.left, speed - half), (pioneer.right, speed + half)):
            connection.call("setJointTargetVelocity", joint, wheel / pioneer.wheel_radius_m)
        self._robot._tell(sent=Sent(speed, turn, self._robot._clock()))

    def _read(
        self,
        connection: Connection,
        pioneer: Pioneer,
        odometry: WheelOdometry,
        warnings: tuple[str, ...],
    ) -> None:
        simulated = number(connection.call("getSimulationTime"), connection)
        if self._simulated is not None and simulated < self._simulated:
            odometry.rebase()
        self._simulated = simulated
        way = odometry.add(*pioneer.wheel_angles(connection))
        left, right = (
            number(connection.call("getJointVelocity", joint), connection) * pioneer.wheel_radius_m
            for joint in (pioneer.left, pioneer.right)
        )
        now = self._robot._clock()
        self._listen(connection, now)
        self._packets += 1
        counters = {**self._robot.report().counters, "packets": self._packets}
        self._robot._tell(
            phase=RobotPhase.CONNECTED,
            trouble=None,
            warnings=warnings,
            received=now,
            name=pioneer.name,
            odometry=way,
            speed_mps=(left + right) / 2,
            turn_rate_radps=(right - left) / pioneer.track_m,
            sonars=tuple(self._readings[k] for k in sorted(self._readings)),
            counters=counters,
        )

    def _listen(self, connection: Connection, now: float) -> None:
        for _ in range(min(_SONARS_A_TIME, len(self._sonars))):
            k = self._next_sonar
            self._readings[k] = read_sonar(connection, k, self._sonars[k], now)
            self._next_sonar = (k + 1) % len(self._sonars)


def _warnings(connection: Connection, pioneer: Pioneer) -> tuple[str, ...]:
    try:
        scripts = own_scripts(connection, pioneer.handle)
    except CoppeliaSimUnreachable:
        raise
    except CoppeliaSimError:
        return ()
    if not scripts:
        return ()
    return (
        f"{pioneer.path} has a script of its own that drives it as well; remove it, as "
        f"dynamic-observer coppelia-scene does",
    )


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value)) if math.isfinite(value) else 0.0
