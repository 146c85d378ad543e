"""Driver of a P3-DX in a CoppeliaSim scene.

A thread has its own connection to the simulator, so that no call here ever waits for it.
The simulator has no watchdog: if this process is killed, the wheels keep their speed for as long
as simulated time advances.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import ParamSpec, TypeVar

from observer.coppeliasim.address import Address, parse_robot
from observer.coppeliasim.connection import Connection, CoppeliaSimError, CoppeliaSimUnreachable
from observer.coppeliasim.pioneers import (
    MODEL,
    Pioneer,
    WheelOdometry,
    find_pioneer,
    find_sonars,
    own_scripts,
    read_sonar,
)
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
# Sonars read per period; a ring of 16 takes about a quarter of a second.
_SONARS_A_TIME = 4
_RETRY_S = 1.0
_CLOSE_WITHIN_S = 2.0
# Accelerations at which the model's wheels do not slip and its body does not pitch.
_ACCELERATION_MPS2 = 1.0
_TURN_ACCELERATION_RADPS2 = math.radians(180)
_STOP = (0.0, 0.0)

P = ParamSpec("P")
T = TypeVar("T")


def open_coppelia_robot(
    spec: str, model: str | None = None, *, clock: Callable[[], float] = time.monotonic
) -> CoppeliaSimRobot:
    """Open the robot ``coppeliasim:HOST:PORT/PATH``; return at once and connect in the background.

    Raises:
        InputError: the text names no robot, or the model is not a P3-DX.
    """
    address, path = parse_robot(spec)
    if model not in (None, MODEL, "p3dx"):
        raise InputError(f"CoppeliaSim robots are driven as model {MODEL}, not {model}")
    return CoppeliaSimRobot(address, path, clock)


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
        # A request is pending that the thread has not seen yet.
        self._asked = False
        self._setpoint: Sent | None = None
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
        """Return the robot's state; safe from any thread."""
        with self._condition:
            return replace(self._report, motors_enabled=self._enabled)

    def enable(self) -> None:
        """Switch the motors on at zero velocity, if it is connected and has no fault."""
        with self._condition:
            self._setpoint = None
            self._enabled = (
                self._report.phase is RobotPhase.CONNECTED and self._report.fault is None
            )
            self._wake()

    def disable(self) -> None:
        """Set zero velocity and switch the motors off."""
        with self._condition:
            self._setpoint, self._enabled = None, False
            self._wake()

    def stop(self) -> None:
        """Do the same as ``disable``: either way simulated wheels stop as fast as they can."""
        self.disable()

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Hold this velocity until the next one, for ``SETPOINT_FRESH_S`` at most."""
        limits = self._limits
        with self._condition:
            now = self._clock()
            if not self._enabled:
                return Sent(0.0, 0.0, now)
            speed = _within(speed_mps, limits.speed_mps)
            turn = _within(turn_rate_radps, limits.turn_rate_radps)
            self._setpoint = Sent(speed, turn, now)
            self._wake()
            return self._setpoint

    def clear(self) -> None:
        """Clear the fault; motors stay off."""
        with self._condition:
            self._report = replace(self._report, fault=None)

    def close(self) -> None:
        """Stop, switch the motors off and close the connection; wait for at most 2 s."""
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
                    with contextlib.closing(Connection(self._address)) as connection:
                        _Drive(self, connection).run()
                except CoppeliaSimError as error:
                    self._lost(str(error))
                with self._condition:
                    self._condition.wait_for(lambda: self._closing, _RETRY_S)
        finally:
            if not self._closing:
                # After an unexpected error the robot must not appear connected.
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
        """Wait for the next velocity to write; None once the robot is to be closed."""
        with self._condition:
            now, setpoint = self._clock(), self._setpoint
            wait = _PERIOD_S if setpoint is None else min(_PERIOD_S, _until(setpoint) - now)
            self._condition.wait_for(lambda: self._asked or self._closing, max(0.0, wait))
            self._asked = False
            return None if self._closing else self._velocity()

    def _velocity(self) -> tuple[float, float]:
        """Return the velocity that the wheels should have now."""
        with self._condition:
            setpoint = self._setpoint
            if setpoint is None or not self._enabled or self._clock() >= _until(setpoint):
                self._setpoint = None
                return _STOP
            return setpoint.speed_mps, setpoint.turn_rate_radps

    def _tell(self, **facts: object) -> None:
        with self._condition:
            self._report = replace(self._report, **facts)  # type: ignore[arg-type]


class _Drive:
    """Drives one robot over one connection, starting from standstill.

    Raises:
        CoppeliaSimError: the simulator has no such robot.
    """

    def __init__(self, robot: CoppeliaSimRobot, connection: Connection) -> None:
        self._robot = robot
        self._connection = connection
        self._pioneer = find_pioneer(connection, robot._path)
        self._write(_STOP)
        self._sonars = find_sonars(connection, self._pioneer)
        self._warnings = _warnings(connection, self._pioneer)
        self._odometry = WheelOdometry(self._pioneer.wheel_radius_m, self._pioneer.track_m)
        self._readings: dict[int, SonarReading] = {}
        self._next_sonar = 0
        self._simulated: float | None = None

    def run(self) -> None:
        """Drive until the robot is closed.

        Raises:
            CoppeliaSimError: the simulator does not answer, or no longer has the robot.
        """
        self._read()
        try:
            while (velocity := self._robot._next_velocity()) is not None:
                self._write(velocity)
                self._read()
        finally:
            # Nothing else stops the wheels; if the simulator is gone, this fails.
            with contextlib.suppress(CoppeliaSimError):
                self._write(_STOP)

    def _write(self, velocity: tuple[float, float]) -> None:
        # Write it every time, since a restarted simulation has forgotten it.
        speed, turn = self._written = velocity
        pioneer = self._pioneer
        half = turn * pioneer.track_m / 2
        for joint, wheel in ((pioneer.left, speed - half), (pioneer.right, speed + half)):
            self._connection.call("setJointTargetVelocity", joint, wheel / pioneer.wheel_radius_m)
        self._robot._tell(sent=Sent(speed, turn, self._robot._clock()))

    def _read(self) -> None:
        connection, pioneer = self._connection, self._pioneer
        simulated = self._ask(connection.number, "getSimulationTime")
        if self._simulated is not None and simulated < self._simulated:
            self._odometry.rebase()
        self._simulated = simulated
        odometry = self._odometry.add(*self._ask(pioneer.wheel_angles, connection))
        left, right = (
            self._ask(connection.number, "getJointVelocity", joint) * pioneer.wheel_radius_m
            for joint in (pioneer.left, pioneer.right)
        )
        now = self._robot._clock()
        self._listen(now)
        counters = self._robot.report().counters
        self._robot._tell(
            phase=RobotPhase.CONNECTED,
            trouble=None,
            warnings=self._warnings,
            received=now,
            name=pioneer.name,
            odometry=odometry,
            speed_mps=(left + right) / 2,
            turn_rate_radps=(right - left) / pioneer.track_m,
            sonars=tuple(self._readings[k] for k in sorted(self._readings)),
            counters={**counters, "packets": counters["packets"] + 1},
        )

    def _ask(self, asked: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        """Ask the simulator, after writing a lower velocity if one was set meanwhile.

        A slow simulator takes a while for a dozen questions; a stop must not wait for them all.
        """
        velocity = self._robot._velocity()
        if any(abs(new) < abs(old) for new, old in zip(velocity, self._written, strict=True)):
            self._write(velocity)
        return asked(*arguments, **named)

    def _listen(self, now: float) -> None:
        for _ in range(min(_SONARS_A_TIME, len(self._sonars))):
            k = self._next_sonar
            self._readings[k] = self._ask(read_sonar, self._connection, k, self._sonars[k], now)
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
        f"{pioneer.path} also has a script of its own that drives it; remove the script, as "
        "dynamic-observer coppelia-scene does",
    )


def _until(setpoint: Sent) -> float:
    return setpoint.time + SETPOINT_FRESH_S


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value)) if math.isfinite(value) else 0.0
