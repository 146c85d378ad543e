"""Driving the scene's robots: what is commanded and reported, and that no call ever waits."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from observer.coppeliasim import robot as robot_module
from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.coppeliasim.robot import CoppeliaSimRobot, open_coppelia_robot
from observer.errors import InputError
from observer.opening import open_source
from observer.robots.contract import SETPOINT_FRESH_S, Robot, RobotPhase

from ...waiting import until
from .reading import frame_of

pytestmark = pytest.mark.usefixtures("extra")

RADIUS, TRACK = 0.0975, 0.331


@contextmanager
def _robot(running: Any, path: str) -> Iterator[CoppeliaSimRobot]:
    robot = open_coppelia_robot(f"{running.spec}{path}", "p3dx-sh")
    try:
        until(lambda: robot.report().phase is RobotPhase.CONNECTED)
        yield robot
    finally:
        robot.close()
        assert robot.report().phase is RobotPhase.CLOSED


@contextmanager
def _held(robot: Robot, speed: float, turn: float) -> Iterator[None]:
    """Send a velocity repeatedly, as a drive loop does."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(0.02):
            robot.drive(speed, turn)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _targets(connection: Connection, path: str) -> tuple[float, float]:
    left, right = (
        connection.call("getJointTargetVelocity", connection.call("getObject", f"{path}/{motor}"))
        for motor in ("leftMotor", "rightMotor")
    )
    return left, right


def test_driving_the_wheels_moves_the_camera(shared: Any) -> None:
    opened = open_source(shared.spec)
    try:
        ports = {port.role: port.port for port in opened.robots.serve()}
        with _robot(shared, ports["observer"].removeprefix(shared.spec)) as robot:
            assert isinstance(frame_of(opened).time, float)
            robot.enable()
            before = robot.report().odometry
            assert before is not None
            with _held(robot, 0.3, 0.5):
                until(lambda: bool((s := robot.report().sent) and s.speed_mps == 0.3))
                frames = [frame_of(opened) for _ in range(21)]
                seen = robot.report
                until(lambda: abs((seen().speed_mps or 0.0) - 0.3) < 1e-6)
            assert robot.report().turn_rate_radps == pytest.approx(0.5)
            observer, _ = opened.truth.bodies(frames[-1].time)
            assert observer.commanded_speed == pytest.approx(0.3)
            # The frames' odometry, the robot's and the camera's true pose agree on the motion.
            driven = [f.odometry for f in frames]
            yaw = driven[-1].yaw - driven[0].yaw
            assert yaw == pytest.approx(0.5 * 1.0, abs=0.03)
            # The robot polls by itself, a moment after the last step.
            until(
                lambda: math.isclose(
                    robot.report().odometry.yaw - before.yaw, driven[-1].yaw, abs_tol=1e-6
                )
            )
            poses = [opened.truth.camera_pose(f.time) for f in (frames[0], frames[-1])]
            turned = (poses[0].inverse() @ poses[1]).rotvec
            assert math.sqrt(float(turned @ turned)) == pytest.approx(yaw, abs=1e-6)
            moved = poses[1].translation - poses[0].translation
            assert 0.2 < math.sqrt(float(moved @ moved)) < 0.35
    finally:
        opened.source.close()


def test_it_stops_without_repeated_commands_and_moves_only_if_enabled(shared: Any) -> None:
    path = "/PioneerP3DX[1]"
    with shared.connected() as other, _robot(shared, path) as robot:
        assert robot.drive(0.4, 0.0).speed_mps == 0.0
        assert not robot.report().motors_enabled
        robot.enable()
        assert robot.report().motors_enabled
        worst = 0.0
        for _ in range(3):
            with _held(robot, 0.4, 0.2):
                until(lambda: _targets(other, path)[0] > 0)
                left, right = _targets(other, path)
                assert (left + right) / 2 * RADIUS == pytest.approx(0.4)
                assert (right - left) * RADIUS / TRACK == pytest.approx(0.2)
            last = time.monotonic()
            until(lambda: _targets(other, path) == (0.0, 0.0))
            worst = max(worst, time.monotonic() - last)
        print(f"\nwheels at zero after the last drive(): worst {worst * 1000:.0f} ms of 3")  # noqa: T201
        assert worst < SETPOINT_FRESH_S + 0.5
        sent = robot.drive(99.0, -99.0)
        limits = robot.report().limits
        assert (sent.speed_mps, sent.turn_rate_radps) == (
            limits.speed_mps, -limits.turn_rate_radps,
        )  # fmt: skip
        sent = robot.drive(math.nan, math.inf)
        assert (sent.speed_mps, sent.turn_rate_radps) == (0.0, 0.0)
        robot.drive(0.4, 0.0)
        robot.stop()
        assert robot.drive(0.4, 0.0).speed_mps == 0.0
        until(lambda: _targets(other, path) == (0.0, 0.0))
        robot.enable()
        robot.drive(0.4, 0.0)
        robot.close()
        assert _targets(other, path) == (0.0, 0.0)


@pytest.mark.parametrize("how", ["stop", "slower", "expired", "close"])
def test_a_stop_does_not_wait_for_the_questions_of_a_slow_simulator(
    bare: Any, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    call, calls = Connection.call, list[tuple[float, str, tuple[Any, ...]]]()
    slow = threading.Event()

    def slow_call(connection: Connection, function: str, *arguments: Any, **options: Any) -> Any:
        if slow.is_set() and threading.current_thread().name.startswith("driving"):
            calls.append((time.monotonic(), function, arguments))
            time.sleep(0.05)
        return call(connection, function, *arguments, **options)

    with bare.connected() as other:
        other.call("loadModel", "models/robots/mobile/pioneer p3dx.ttm")
    monkeypatch.setattr(Connection, "call", slow_call)
    with _robot(bare, "/PioneerP3DX") as robot:
        robot.enable()
        with _held(robot, 0.4, 0.0):
            until(lambda: bool((s := robot.report().sent) and s.speed_mps == 0.4))
            slow.set()
            # The thread is now in the first of a dozen questions.
            until(lambda: any(c[1] == "getSimulationTime" for c in list(calls)))
        asked_at = time.monotonic()
        if how == "stop":
            robot.stop()
        elif how == "slower":
            robot.drive(0.1, 0.0)
        elif how == "close":
            robot.close()
        else:
            asked_at += SETPOINT_FRESH_S
        until(
            lambda: any(c[1] == "setJointTargetVelocity" and c[0] > asked_at for c in list(calls))
        )
        slow.clear()
        later = [c for c in calls if c[0] > asked_at]
        before = [c[1] for c in later].index("setJointTargetVelocity")
        assert before <= 1, [c[1] for c in later]
        expected = 0.1 if how == "slower" else 0.0
        assert later[before][2][1] * RADIUS == pytest.approx(expected)


def test_sonars_and_warnings_are_reported(bare: Any) -> None:
    with bare.connected() as other:
        handle = other.call("loadModel", "models/robots/mobile/pioneer p3dx.ttm")
        # So that the sensor looking 10 degrees left is 0.5 m from the front wall at x = 5.4 m.
        ahead = 5.4 - 0.5 - (0.15 + 0.5) * math.cos(math.radians(10)) + 0.5
        other.call("setObjectPose", handle, [ahead, 0.0, 0.1388, 0.0, 0.0, 0.0, 1.0])
        with _robot(bare, "/PioneerP3DX") as robot:
            until(lambda: len(robot.report().sonars) == 8)
            sonars = robot.report().sonars
            assert [s.index for s in sonars] == list(range(8))
            assert math.degrees(sonars[3].heading) == pytest.approx(10)
            assert sonars[3].range_m == pytest.approx(0.5, abs=1e-6)
            assert sonars[0].range_m is None
            # The model's own script would drive it too.
            assert "has a script of its own" in robot.report().warnings[0]


def test_a_hung_simulator_is_a_fault_and_blocks_no_call(bare: Any) -> None:
    with bare.connected() as other:
        other.call("loadModel", "models/robots/mobile/pioneer p3dx.ttm")
    with _robot(bare, "/PioneerP3DX") as robot:
        robot.enable()
        os.kill(bare.process.pid, signal.SIGSTOP)
        try:
            longest = 0.0
            started = time.monotonic()
            while robot.report().fault is None and time.monotonic() - started < 5:
                before = time.monotonic()
                robot.drive(0.3, 0.0)
                longest = max(longest, time.monotonic() - before)
                time.sleep(0.01)
            report = robot.report()
            assert report.fault is not None
            assert "did not answer" in report.fault
            assert time.monotonic() - started < 2.5
            # No call here waits for the simulator; the rest is the machine's scheduling.
            assert longest < 0.25
            assert report.phase is RobotPhase.WAITING
            assert not report.motors_enabled
            robot.enable()
            assert robot.drive(0.3, 0.0).speed_mps == 0.0
        finally:
            os.kill(bare.process.pid, signal.SIGCONT)
        until(lambda: robot.report().phase is RobotPhase.CONNECTED)
        # It is back, but moves only once the fault has been cleared.
        robot.enable()
        assert not robot.report().motors_enabled
        robot.clear()
        robot.enable()
        assert robot.drive(0.3, 0.0).speed_mps == 0.3
        assert robot.report().counters["reconnects"] == 1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize(
    ("error", "phase"),
    [
        (CoppeliaSimError("the sensor is gone"), RobotPhase.WAITING),
        (RuntimeError("a mistake in the driver"), RobotPhase.REFUSED),
    ],
)
def test_any_error_in_the_driver_stops_the_wheels(
    shared: Any, monkeypatch: pytest.MonkeyPatch, error: Exception, phase: RobotPhase
) -> None:
    path, failing, read = "/PioneerP3DX[1]", threading.Event(), robot_module._Drive._read

    def failing_read(*arguments: Any) -> None:
        if failing.is_set():
            raise error
        read(*arguments)

    monkeypatch.setattr(robot_module._Drive, "_read", failing_read)
    monkeypatch.setattr(robot_module, "_RETRY_S", 60.0)
    with shared.connected() as other, _robot(shared, path) as robot:
        robot.enable()
        with _held(robot, 0.3, 0.0):
            until(lambda: _targets(other, path)[0] > 0)
            failing.set()
            until(lambda: robot.report().phase is phase)
            assert _targets(other, path) == (0.0, 0.0)
        report = robot.report()
        assert report.fault == report.trouble
        assert report.fault == ("its driver failed" if phase is RobotPhase.REFUSED else str(error))
        assert not report.motors_enabled


def test_a_missing_simulator_or_robot_is_reported_and_awaited(bare: Any, free_port: int) -> None:
    with pytest.raises(InputError, match="are driven as model p3dx-sh, not amigo"):
        open_coppelia_robot("coppeliasim:127.0.0.1:1/PioneerP3DX", "amigo")
    unreachable = open_coppelia_robot(f"coppeliasim:127.0.0.1:{free_port}/PioneerP3DX")
    until(lambda: unreachable.report().phase is RobotPhase.WAITING)
    report = unreachable.report()
    assert "nothing listens" in report.trouble
    assert report.fault is None
    unreachable.close()
    robot = open_coppelia_robot(f"{bare.spec}/PioneerP3DX")
    try:
        until(lambda: robot.report().trouble is not None)
        assert "has no P3-DX /PioneerP3DX with leftMotor and rightMotor; there are: none" in (
            robot.report().trouble
        )
        with bare.connected() as other:
            other.call("loadModel", "models/robots/mobile/pioneer p3dx.ttm")
        until(lambda: robot.report().phase is RobotPhase.CONNECTED)
        assert robot.report().trouble is None
    finally:
        robot.close()
