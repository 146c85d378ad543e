"""Robots of a simulated world: the loop from a command's bytes to the next rendered frame."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from functools import partial

import numpy as np
import pytest

from observer.opening import OpenedSource, open_source
from observer.rig.rig import Role
from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.motion import Parked, PlanarState
from observer.simulation.robots.driven import Driven
from observer.simulation.robots.world_robots import SimulatedRobots
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World

RATE = 20
SCENE = """
title: A title
help: A sentence.
declares: ideal
duration_s: 3
frame_rate: 20
camera: {width: 64, height: 64, hfov_deg: 60}
room: {x: [-2, 4], y: [-2, 2]}
objects: [{kind: crate, x: 2.0, y: 0, size: [0.5, 0.5, 0.5]}]
robots:
  - {x: 0.8, y: -1.2, heading_deg: 90,
     motion: {kind: course, after: back, legs: [{kind: drive, distance_m: 2.4, speed: 0.4}]}}
  - {name: second, x: 3.4, y: 1.5}
observer: {motion: {kind: sway, turn: {amplitude: 5, period_s: 4}}}
faults: {skew_s: 0.02}
"""


def _begins_with(number: int, packet: bytes) -> bool:
    return packet[0] == number


class Link:
    """A client of one robot."""

    def __init__(self, port: str) -> None:
        host, number = port.removeprefix("socket://").split(":")
        self._connection = socket.create_connection((host, int(number)), 5)
        self._connection.settimeout(5)
        self._parser = PacketParser()
        for k in (0, 1, 2):
            self.say(k)
            self.hear(partial(_begins_with, k))
        self.say(Command.OPEN)

    def say(self, number: int, argument: int | None = None) -> None:
        self._connection.sendall(command(number, argument))

    def hear(self, wanted: Callable[[bytes], bool]) -> bytes:
        deadline = time.monotonic() + 5
        while time.monotonic() < deadline:
            for each in self._parser.feed(self._connection.recv(4096)):
                if wanted(each):
                    return each
        raise AssertionError("nothing of the kind came")

    def drain(self) -> list[bytes]:
        """Return what has arrived so far."""
        found: list[bytes] = []
        self._connection.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                found += self._parser.feed(self._connection.recv(65536))
        self._connection.settimeout(5)
        return found

    def close(self) -> None:
        self._connection.close()


class Lab:
    """A scene with served robots, and one client each."""

    def __init__(self, text: str = SCENE, seed: int = 0) -> None:
        self.world = World(scenario_from_text(text, "mine"), seed)
        self.source = SimulatedSource(self.world)
        self.truth = SimulatedTruth(self.world)
        self.robots = SimulatedRobots(self.world, self.source)
        self.ports = {each.role: each for each in self.robots.serve()}
        self.links = {role: Link(port.port) for role, port in self.ports.items()}
        self.time = -1.0

    def enable(self, role: Role) -> None:
        """Switch the motors on, and wait until the world has received it."""
        self.tell(role, Command.ENABLE, 1)

    def tell(self, role: Role, number: int, argument: int | None = None) -> None:
        log = self.robots.servings[role].robot.log
        before = log.count
        self.links[role].say(number, argument)
        deadline = time.monotonic() + 5
        while log.count == before:
            assert time.monotonic() < deadline, "the command did not arrive"
            time.sleep(0.001)
        # The log is written after the command took effect.

    def frames(self, seconds: float, speaking: Callable[[], None] = lambda: None) -> None:
        for _ in range(round(seconds * RATE)):
            speaking()
            frame = self.source.read()
            assert frame is not None
            self.time, self.odometry = frame.time, frame.odometry
            self.left = frame.left

    def state(self, role: str, time: float | None = None) -> PlanarState:
        body = self.world.observer if role == "observer" else self.world.obstacles[0]
        return body.motion.state(self.time if time is None else time)

    def close(self) -> None:
        for link in self.links.values():
            link.close()
        self.robots.close()


MakeLab = Callable[..., Lab]


@pytest.fixture
def make_lab() -> Iterator[MakeLab]:
    """Labs that are closed after the test, however it ends."""
    with ExitStack() as stack:
        yield lambda *of_it, **named: stack.enter_context(closing(Lab(*of_it, **named)))


@pytest.fixture
def lab(make_lab: MakeLab) -> Lab:
    return make_lab()


def holding(lab: Lab, role: Role, speed: int, turn_rate: int = 0) -> Callable[[], None]:
    def say() -> None:
        lab.tell(role, Command.VEL, speed)
        lab.tell(role, Command.RVEL, turn_rate)

    return say


# ---------------------------------------------------------------------- before anybody drives


def test_no_thread_runs_before_serving_and_each_world_has_its_own_name() -> None:
    threads = set(threading.enumerate())
    one, other = open_source("simulated:drive?seed=2"), open_source("simulated:drive?seed=2")
    assert set(threading.enumerate()) == threads
    assert isinstance(one, OpenedSource)
    assert one.robots is not None
    assert other.robots is not None
    assert one.robots.world.startswith("simulated:drive?seed=2:")
    assert one.robots.world != other.robots.world
    one.robots.close()


def test_the_calibration_scene_has_no_robots() -> None:
    assert open_source("simulated:calibration").robots is None


def test_roles_models_and_ports(make_lab: MakeLab) -> None:
    lab = make_lab()
    found = [(each.role, each.model, each.name) for each in lab.ports.values()]
    assert found == [("observer", "amigo-sh", "AmigoBot"), ("obstacle", "p3dx-sh", "P3-DX")]
    assert tuple(lab.ports.values()) == lab.robots.serve()
    lab.close()
    lab.robots.close()
    for port in lab.ports.values():
        with pytest.raises(ConnectionRefusedError):
            Link(port.port)
    alone = make_lab(SCENE.split("robots:")[0] + "observer: {}\n")
    assert list(alone.ports) == ["observer"]


def test_a_person_is_not_served_as_a_robot() -> None:
    world = World(load_scenario("people"))
    with closing(SimulatedRobots(world, SimulatedSource(world))) as robots:
        assert [(each.role, each.name) for each in robots.serve()] == [("observer", "AmigoBot")]


def test_robots_that_are_not_driven_change_no_frame_and_end_with_the_scenario(
    make_lab: MakeLab,
) -> None:
    lab = make_lab()
    plain = SimulatedSource(World(scenario_from_text(SCENE, "mine")))
    for _ in range(2):
        for _ in range(3 * RATE):
            frame, expected = lab.source.read(), plain.read()
            assert frame is not None
            assert expected is not None
            assert np.array_equal(frame.left, expected.left)
            assert np.array_equal(frame.right, expected.right)
            assert frame.odometry == expected.odometry
        assert lab.source.read() is None
        lab.source.rewind()
        plain.rewind()


def test_a_scripted_robot_reports_its_true_motion(lab: Lab) -> None:
    lab.frames(1.0)
    lab.links["obstacle"].drain()
    heard: list[bytes] = []
    deadline = time.monotonic() + 20
    while not any(each[0] == 0x33 for each in heard) and time.monotonic() < deadline:
        if lab.time > 2.5:
            lab.source.rewind()
            lab.frames(1.0)
            lab.links["obstacle"].drain()
        lab.frames(1 / RATE, lambda: time.sleep(0.04))
        heard = lab.links["obstacle"].drain()
    packet = next(each for each in heard if each[0] == 0x33)
    left, right = (int.from_bytes(packet[k : k + 2], "little", signed=True) for k in (7, 9))
    assert left == right == pytest.approx(400, abs=12)
    assert packet[16] & 1 == 0


# ---------------------------------------------------------------------- driven


def test_driving_starts_where_the_script_left_the_robot(lab: Lab) -> None:
    lab.frames(1.0)
    last = lab.time
    scripted = [lab.state("obstacle", last - k / 100) for k in range(3)]
    lab.enable("obstacle")
    lab.frames(0.05)
    before, after = lab.state("obstacle", last), lab.state("obstacle")
    assert before == scripted[0]
    assert [lab.state("obstacle", last - k / 100) for k in range(3)] == scripted
    # The pose is continuous, and it brakes from now on, because no velocity is requested.
    assert math.hypot(before.vx, before.vy) == pytest.approx(0.4)
    assert math.hypot(after.x - before.x, after.y - before.y) == pytest.approx(0.02, abs=2e-3)
    lab.frames(2.5, lambda: lab.tell("obstacle", Command.PULSE))
    assert (lab.state("obstacle").vx, lab.state("obstacle").vy) == pytest.approx((0, 0), abs=1e-9)
    assert lab.truth.bodies(lab.time)[1].commanded_speed == 0.0


def test_a_velocity_moves_the_camera_truth_odometry_and_commanded_speed(lab: Lab) -> None:
    lab.frames(0.5)
    lab.enable("observer")
    first = lab.left.copy()
    start, wheels = lab.state("observer"), lab.odometry
    lab.frames(2.0, holding(lab, "observer", 200, 20))
    end = lab.state("observer")
    body = lab.truth.bodies(lab.time)[0]
    assert body.commanded_speed == pytest.approx(0.2)
    assert body.speed == pytest.approx(0.2, abs=0.005)
    distance = math.hypot(end.x - start.x, end.y - start.y)
    assert 0.2 < distance < 0.4
    assert end.turn_rate == pytest.approx(math.radians(20), abs=0.01)
    drive = math.hypot(lab.odometry.x - wheels.x, lab.odometry.y - wheels.y)
    assert drive == pytest.approx(distance, rel=0.06)
    assert np.abs(lab.left.astype(int) - first).mean() > 5
    # The pose moves with it, and time 0 remains the world's origin.
    moved = lab.truth.camera_pose(lab.time).translation
    assert np.hypot(*moved[[0, 2]]) > 0.2
    assert np.allclose(lab.truth.camera_pose(0.0).matrix, np.eye(4))


def test_frames_and_scripts_continue_while_a_robot_is_driven(lab: Lab) -> None:
    lab.frames(2.9)
    lab.enable("observer")
    lab.frames(2.0, lambda: lab.tell("observer", Command.PULSE))
    assert lab.time > 4.5
    script = lab.world.obstacles[0].motion
    assert isinstance(script, Driven)
    assert lab.state("obstacle") == script.script.state(lab.time)


def test_it_stalls_at_the_crate_and_its_sonar_sees_it_and_the_walls(make_lab: MakeLab) -> None:
    lab = make_lab(SCENE.split("robots:")[0] + "observer: {}\n")
    lab.enable("observer")
    lab.tell("observer", Command.SETA, 2000)
    link, push = lab.links["observer"], holding(lab, "observer", 900)
    lab.frames(3.0, push)
    # It has stalled, and every sonar has fired since.
    time.sleep(0.6)
    link.drain()
    # On a busy machine the sleep takes longer and it stops pushing, so push again.
    push()
    packet = link.hear(lambda each: each[0] in (0x32, 0x33) and each[12] & 1 == 1)
    assert packet[13] & 1 == 1
    assert lab.state("observer").x == pytest.approx(1.75 - 0.165, abs=0.01)
    ranges: dict[int, int] = {}
    while len(ranges) < 8:
        packet = link.hear(lambda each: each[0] in (0x32, 0x33))
        for k in range(packet[19]):
            at = 20 + 3 * k
            ranges[packet[at]] = int.from_bytes(packet[at + 1 : at + 3], "little")
    assert ranges[2] < 60
    # The left sonar faces the wall at right angles.
    assert ranges[0] == pytest.approx(2000 - 100, abs=2)
    assert ranges[6] > 1500


def test_two_robots_do_not_pass_through_each_other(make_lab: MakeLab) -> None:
    text = SCENE.replace("x: 2.0, y: 0,", "x: 2.0, y: 1.6,").replace(
        "{x: 0.8, y: -1.2, heading_deg: 90,", "{x: 1.5, y: 0, heading_deg: 180,"
    ).replace("distance_m: 2.4, speed: 0.4", "distance_m: 0.2, speed: 0.01")  # fmt: skip
    lab = make_lab(text)
    for role in ("observer", "obstacle"):
        lab.enable(role)
        lab.tell(role, Command.SETA, 2000)

    def both() -> None:
        holding(lab, "observer", 400)()
        holding(lab, "obstacle", 400)()

    lab.frames(3, both)
    gap = lab.state("obstacle").x - lab.state("observer").x
    assert gap == pytest.approx((0.33 + 0.455) / 2, abs=0.02)


def test_robots_move_in_frame_time_not_in_real_time(lab: Lab) -> None:
    lab.enable("observer")
    lab.frames(0.5, holding(lab, "observer", 300))
    place = lab.state("observer")
    link = lab.links["observer"]
    moving = time.monotonic()
    # While paused it stays where it is and its wheels do not turn, despite drive commands.
    while time.monotonic() < moving + 0.8:
        holding(lab, "observer", 300)()
        time.sleep(0.02)
    assert lab.state("observer", lab.time) == place
    link.drain()
    packet = link.hear(lambda each: each[0] in (0x32, 0x33))
    assert packet[0] == 0x32
    assert packet[7:11] == bytes(4)
    lab.frames(0.1, holding(lab, "observer", 300))
    assert lab.state("observer").x > place.x + 0.005


def test_the_watchdog_stops_the_robot_of_a_dead_client(lab: Lab) -> None:
    lab.enable("observer")
    lab.frames(1.0, holding(lab, "observer", 200))
    assert lab.truth.bodies(lab.time)[0].speed > 0.15
    lab.links["observer"].close()
    firmware = lab.robots.servings["observer"].robot
    deadline = time.monotonic() + 10
    while not firmware.timed_out:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    lab.frames(1.5)
    body = lab.truth.bodies(lab.time)[0]
    assert (body.speed, body.commanded_speed) == (0.0, 0.0)


def test_rewinding_puts_robots_back_at_the_start_with_motors_off(lab: Lab) -> None:
    frame = lab.source.read()
    assert frame is not None
    lab.enable("observer")
    lab.enable("obstacle")
    lab.frames(1.0, holding(lab, "observer", 300))
    later = 10 / RATE
    driven = lab.truth.bodies(later)
    lab.links["observer"].hear(lambda each: each[0] in (0x32, 0x33) and each[16] & 1 == 1)
    lab.links["observer"].drain()
    lab.source.rewind()
    again = lab.source.read()
    assert again is not None
    assert np.array_equal(again.left, frame.left)
    assert again.odometry == frame.odometry
    packet = lab.links["observer"].hear(lambda each: each[0] in (0x32, 0x33) and not each[16] & 1)
    assert packet[16] & 1 == 0
    lab.time = 0.0
    scripted = World(scenario_from_text(SCENE, "mine"))
    lab.frames(1.0, holding(lab, "observer", 300))
    assert lab.state("observer") == scripted.observer.motion.state(lab.time)
    truth = SimulatedTruth(scripted).bodies(later)
    for body, expected, before in zip(lab.truth.bodies(later), truth, driven, strict=True):
        assert np.array_equal(body.position, expected.position)
        assert body.id == before.id
    assert not np.array_equal(driven[0].position, truth[0].position)
    # They can be driven again.
    lab.enable("observer")
    lab.frames(1.0, holding(lab, "observer", 300))
    assert lab.truth.bodies(lab.time)[0].speed > 0.2


def test_equal_commands_at_equal_frames_give_equal_paths(make_lab: MakeLab) -> None:
    ends = []
    for _ in range(2):
        lab = make_lab(seed=3)
        lab.frames(0.5)
        lab.enable("observer")
        lab.frames(1.5, holding(lab, "observer", 250, 15))
        ends.append((lab.state("observer"), lab.odometry, lab.left))
    assert ends[0][:2] == ends[1][:2]
    assert np.array_equal(ends[0][2], ends[1][2])


# ---------------------------------------------------------------------- the motion itself


def test_motion_is_interpolated_between_steps_and_extrapolated_after_the_last() -> None:
    motion = Driven(Parked(1.0, 2.0, 0.0), threading.RLock())
    assert motion.state(5.0) == PlanarState(1.0, 2.0, 0.0)
    motion.begin(5.0, PlanarState(1.0, 2.0, 0.0))
    for k in range(1, 5):
        motion.add(5.0 + k / 100, PlanarState(1.0 + k / 100, 2.0, 0.0, 1.0), 1.0)
    assert motion.state(4.0) == PlanarState(1.0, 2.0, 0.0)
    assert motion.state(5.025).x == pytest.approx(1.025)
    assert motion.state(5.005).vx == pytest.approx(0.5)
    assert motion.state(5.09).x == pytest.approx(1.09)
    assert motion.state(9.0).x < 1.5
    assert (motion.commanded_speed(4.9), motion.commanded_speed(5.02)) == (0.0, 1.0)
    motion.add(5.05, PlanarState(1.05, 2.0, 0.0, 1.0, 0.0, math.pi), 1.0)
    turned = motion.state(5.15)
    assert turned.heading == pytest.approx(0.1 * math.pi)
    assert turned.x == pytest.approx(1.05 + math.sin(0.1 * math.pi) / math.pi)
    assert turned.y == pytest.approx(2.0 + (1 - math.cos(0.1 * math.pi)) / math.pi)
    motion.forget()
    assert motion.state(5.025) == PlanarState(1.0, 2.0, 0.0)


def test_times_before_the_memory_give_the_oldest_known_state() -> None:
    motion = Driven(Parked(0.0, 0.0, 0.0), threading.RLock())
    motion.begin(0.0, PlanarState(0.0, 0.0, 0.0))
    for k in range(1, 3000):
        motion.add(k / 100, PlanarState(k / 100, 0.0, 0.0, 1.0), 1.0)
    assert motion.state(25.0).x == pytest.approx(25.0)
    assert motion.state(1.0).x == pytest.approx(20.0)
    assert motion.state(0.0).x == 0.0
