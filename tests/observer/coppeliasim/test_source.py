"""A scene as a source: calibration, images, timestamps and truth, and what may go wrong."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import pytest

from observer.coppeliasim.connection import Connection
from observer.errors import SourceError
from observer.geometry import Float64Array
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.parameters import Parameters
from observer.types import Image

from ...waiting import until
from .reading import frame_of, wait_until_stopped

pytestmark = pytest.mark.usefixtures("extra")

DT = 0.05
_MOST_S = 2.5
_MODEL = "models/robots/mobile/pioneer p3dx.ttm"
_CAMERAS = ("leftCamera", "rightCamera")


@contextmanager
def _opened(running: Any) -> Iterator[OpenedSource]:
    opened = open_source(running.spec)
    try:
        yield opened
    finally:
        opened.source.close()


@contextmanager
def _fails_soon(match: str) -> Iterator[None]:
    started = time.monotonic()
    with pytest.raises(SourceError, match=match) as told:
        yield
    assert time.monotonic() - started < _MOST_S
    assert "\n" not in str(told.value)


def _roll(connection: Connection, robot: str, left: float, right: float) -> None:
    for motor, velocity in (("leftMotor", left), ("rightMotor", right)):
        handle = connection.call("getObject", f"{robot}/{motor}")
        connection.call("setJointTargetVelocity", handle, velocity)


def _redness(image: Image, px: Float64Array) -> float:
    """Return by how many grey levels red exceeds green around a pixel."""
    u, v = (round(float(n)) for n in px)
    patch = image[v - 3 : v + 4, u - 3 : u + 4].astype(float)
    return float((patch[..., 2] - patch[..., 1]).mean())


def test_source_info_describes_the_scene(shared: Any) -> None:
    with _opened(shared) as opened:
        info = opened.source.info
        assert (info.kind, info.spec, info.live, info.frame_count) == (
            "coppeliasim", shared.spec, False, None,
        )  # fmt: skip
        assert (info.width, info.height, info.frame_rate) == (512, 256, 20.0)
        assert info.mount_height_m == pytest.approx(0.40, abs=1e-9)
        assert info.mount_tilt_rad == pytest.approx(math.radians(5), abs=1e-9)
        # From the middle of the axle, which is not the model's origin.
        assert info.mount_forward_m == pytest.approx(0.07, abs=1e-9)
        assert info.mount_left_m == pytest.approx(0.06, abs=1e-9)


def test_the_calibration_follows_from_the_sensors(shared: Any) -> None:
    with _opened(shared) as opened:
        c = opened.source.calibration
        assert c is not None
        assert c.is_rectified
        assert c.K1[0, 0] == pytest.approx(443.405, abs=1e-3)
        assert c.K1[1, 1] == c.K1[0, 0]
        assert c.K1[:2, 2].tolist() == [255.5, 127.5]
        assert c.T.tolist() == pytest.approx([-0.12, 0, 0], abs=1e-9)


def test_robots_are_listed_with_their_roles(shared: Any) -> None:
    with _opened(shared) as opened:
        assert opened.robots is not None
        assert opened.robots.world == shared.spec
        ports = opened.robots.serve()
        assert [(p.role, p.port, p.model) for p in ports] == [
            ("observer", f"{shared.spec}/PioneerP3DX", "p3dx-sh"),
            ("obstacle", f"{shared.spec}/PioneerP3DX[1]", "p3dx-sh"),
        ]
        assert ports[0].name != ports[1].name


def test_truth_images_and_calibration_agree(shared: Any) -> None:
    """The red robot is where truth and calibration put it: in both images, upright, in BGR."""
    with _opened(shared) as opened:
        frame = frame_of(opened)
        c, truth = opened.source.calibration, opened.truth
        assert c is not None
        assert truth is not None
        assert truth.camera_pose(frame.time).translation == pytest.approx([0, 0, 0], abs=1e-9)
        observer, obstacle = truth.bodies(frame.time)
        assert (observer.role, obstacle.role) == ("observer", "obstacle")
        px = c.K1 @ obstacle.position
        left = px[:2] / px[2] - [0, 6]
        disparity = c.K1[0, 0] * c.baseline / obstacle.position[2]
        # Beside the wheel, on its red side.
        side, beyond = np.array([22.0, 8.0]), np.array([82.0, 8.0])
        for image, at in ((frame.left, left), (frame.right, left - [disparity, 0])):
            assert _redness(image, at + side) > 80
            assert _redness(image, at + beyond) < 60
        # The floor below is wood, the wall above is blue.
        assert 20 < _redness(frame.left, np.array([256.0, 240.0])) < 60
        assert _redness(frame.left, np.array([155.0, 30.0])) < 0


def test_frame_truth_and_odometry_share_one_instant(shared: Any) -> None:
    with shared.connected() as other, _opened(shared) as opened:
        _roll(other, "/PioneerP3DX[1]", 4.0, 6.0)
        _roll(other, "/PioneerP3DX", 1.0, 1.0)
        positions, times, cameras = [], [], []
        for k in range(8):
            frame = frame_of(opened)
            assert frame.index == k
            times.append(frame.time)
            observer, obstacle = opened.truth.bodies(frame.time)
            positions.append(obstacle.position)
            cameras.append(opened.truth.camera_pose(frame.time).translation)
        _roll(other, "/PioneerP3DX[1]", 0.0, 0.0)
        _roll(other, "/PioneerP3DX", 0.0, 0.0)
        assert np.diff(times) == pytest.approx([DT] * 7)
        step = (positions[-1] - positions[-2]) / DT
        speed = (4.0 + 6.0) / 2 * 0.0975
        assert obstacle.commanded_speed == pytest.approx(speed)
        # The centre of its outline coincides with the model's origin except in height.
        assert obstacle.velocity == pytest.approx(step, abs=0.02 * speed)
        assert obstacle.speed == pytest.approx(speed, rel=0.01)
        driven = 7 * DT * 0.0975
        # The camera looks down by 5 degrees, so driving ahead also moves it up in its own axes.
        ahead = [0, -driven * math.sin(math.radians(5)), driven * math.cos(math.radians(5))]
        assert cameras[-1] == pytest.approx(ahead, abs=1e-6)
        assert frame.odometry.x == pytest.approx(driven, abs=1e-6)
        assert observer.velocity == pytest.approx((cameras[-1] - cameras[-2]) / DT, abs=1e-6)
        # It comes from the left, so turning left turns it towards us.
        assert obstacle.yaw < math.pi / 2


def test_simulation_time_does_not_advance_between_frames(shared: Any) -> None:
    """Longer than the simulator remembers a silent client."""
    with _opened(shared) as opened:
        before = frame_of(opened).time
        time.sleep(1.5)
        assert frame_of(opened).time == pytest.approx(before + DT)


def test_stepping_resumes_after_the_simulator_forgot_the_client(shared: Any) -> None:
    with _opened(shared) as opened:
        opened.source.read()
        before = frame_of(opened).time
        cast(Any, opened.source)._connection.call("setStepping", False)
        time.sleep(0.2)
        times = [frame_of(opened).time for _ in range(4)]
        assert times[0] > before + 2 * DT
        assert np.diff(times) == pytest.approx([DT] * 3)


def test_a_still_scene_does_not_look_like_a_frozen_camera(shared: Any) -> None:
    """Rendered images of it are identical to the last pixel, so camera noise is added."""
    with _opened(shared) as opened:
        first = frame_of(opened)
        observer = Observer(opened.source.calibration, Parameters())
        seen = [observer.observe(f) for f in (first, *(frame_of(opened) for _ in range(6)))]
        assert [o.status for o in seen[2:]] == ["ok"] * 5, seen[-1].reasons
        last = frame_of(opened)
    change = np.abs(last.left.astype(int) - first.left)
    assert 0.5 < change.mean() < 2
    assert change.max() < 12


def test_rewinding_restarts_the_scene(shared: Any) -> None:
    with shared.connected() as other, _opened(shared) as opened:
        first = frame_of(opened)
        _roll(other, "/PioneerP3DX[1]", 5.0, 5.0)
        for _ in range(5):
            last = frame_of(opened)
        opened.source.rewind()
        again = frame_of(opened)
        assert (again.index, again.time) == (0, first.time)
        assert again.odometry == first.odometry
        assert np.array_equal(again.left, first.left)
        assert not np.array_equal(again.left, last.left)


def test_closing_stops_only_a_simulation_that_the_source_started(shared: Any) -> None:
    with shared.connected() as other:
        with _opened(shared) as opened:
            opened.source.read()
        wait_until_stopped(other)
        other.call("startSimulation")
        with _opened(shared) as opened:
            opened.source.read()
        assert other.call("getSimulationState") != other.constant("simulation_stopped")
        now = other.call("getSimulationTime")
        until(lambda: other.call("getSimulationTime") > now)
        other.call("stopSimulation")
        wait_until_stopped(other)


def test_a_dead_stepping_client_does_not_block_for_long(shared: Any) -> None:
    dead = Connection(shared.address)
    dead.call("setStepping", True)
    dead._abandon()
    with _opened(shared) as opened:
        times = [frame_of(opened).time for _ in range(3)]
    assert np.diff(times) == pytest.approx([DT] * 2)


def test_a_stopped_or_paused_simulation_is_reported(shared: Any) -> None:
    with shared.connected() as other:
        for what in ("stopSimulation", "pauseSimulation"):
            with _opened(shared) as opened:
                opened.source.read()
                other.call(what)
                time.sleep(0.05)
                with _fails_soon("does not advance beyond .* as if it had been stopped or paused"):
                    opened.source.read()
        other.call("stopSimulation")


def test_a_second_stepping_program_is_reported(
    shared: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from coppeliasim_zmqremoteapi_client import RemoteAPIClient

    with _opened(shared) as opened:
        opened.source.read()
        # The ordinary client is remembered for ten minutes, even after it is gone.
        monkeypatch.setattr(sys.modules["__main__"], "require", None, raising=False)
        program = RemoteAPIClient("127.0.0.1", shared.address.port)
        program.socket.linger = 0
        try:
            sim = program.require("sim")
            sim.setStepping(True)
            with _fails_soon(r"did not answer sim.step .* such as a second program that steps it"):
                opened.source.read()
            sim.setStepping(False)
            sim.stopSimulation()
        finally:
            program.socket.close()
            program.context.term()


def test_a_missing_sensor_pair_is_added_to_the_robot_and_found_again(bare: Any) -> None:
    with _fails_soon("neither two vision sensors side by side nor a P3-DX .* coppelia-scene 127"):
        open_source(bare.spec)
    with bare.connected() as other:
        other.call("loadModel", _MODEL)
        for _ in range(2):
            with _opened(bare) as opened:
                info = opened.source.info
                assert (info.width, info.height) == (512, 256)
                assert info.mount_height_m == pytest.approx(0.34, abs=1e-9)
                assert info.mount_left_m == pytest.approx(0.06, abs=1e-9)
                assert info.mount_tilt_rad == pytest.approx(math.radians(6), abs=1e-9)
                assert opened.source.calibration.is_rectified
                assert frame_of(opened).left.std() > 20
            wait_until_stopped(other)
        kind = other.constant("object_visionsensor_type")
        scene = other.constant("handle_scene")
        assert len(other.call("getObjectsInTree", scene, kind, 0)) == 2


def test_sensors_are_found_by_position_and_mismatches_are_reported(bare: Any) -> None:
    with bare.connected() as other:
        other.call("loadModel", _MODEL)
        open_source(bare.spec).source.close()
        wait_until_stopped(other)
        left, right = (other.call("getObject", f"/{name}") for name in _CAMERAS)
        width = other.constant("visionintparam_resolution_x")
        # With the names gone, only their places tell left from right.
        other.call("setObjectAlias", left, "b")
        other.call("setObjectAlias", right, "a")
        with _opened(bare) as opened:
            assert opened.source.calibration.T[0] == pytest.approx(-0.12)
            opened.source.read()
            other.call("setObjectInt32Param", right, width, 640)
            with _fails_soon(
                r"returned 491520 bytes \(reported size \[640, 256\]\), not a 512x256 colour"
            ):
                opened.source.read()
        wait_until_stopped(other)
        # Swapped.
        for handle, name in zip((right, left), _CAMERAS, strict=True):
            other.call("setObjectAlias", handle, name)
        with _fails_soon("are not a stereo camera: T places the right camera 0.12 m to the left"):
            open_source(bare.spec)
        other.call("setObjectInt32Param", right, width, 640)
        with _fails_soon(r"differ: \S+ 640x256 at 60 degrees and \S+ 512x256 at 60 degrees; give"):
            open_source(bare.spec)


def test_a_hung_simulator_or_a_lost_object_is_reported(bare: Any) -> None:
    with bare.connected() as other:
        other.call("loadModel", _MODEL)
    with _opened(bare) as opened:
        opened.source.read()
        os.kill(bare.process.pid, signal.SIGSTOP)
        try:
            with _fails_soon("did not answer"):
                opened.source.read()
        finally:
            os.kill(bare.process.pid, signal.SIGCONT)
    with bare.connected() as other, _opened(bare) as opened:
        opened.source.read()
        other.call("removeObjects", [other.call("getObject", "/leftCamera")])
        for _ in range(2):
            with _fails_soon("refused sim.handleVisionSensor: Object does not exist"):
                opened.source.read()
