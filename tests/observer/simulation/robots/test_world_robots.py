"""Robots of a simulated world: the loop from a command's bytes to the next rendered frame."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from observer.robots.arcos import Command
from observer.simulation.robots.driven import Driven
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World

from ....waiting import until
from .lab import RATE, SCENE, Lab, MakeLab, holding


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
    # It relaxes for a second of real time and pushes again only in a frame, so frames continue.
    stalled: list[bytes] = []
    deadline = time.monotonic() + 10
    while not stalled:
        assert time.monotonic() < deadline, "it did not report the stall"
        lab.frames(1 / RATE, push)
        stalled = [each for each in link.drain() if each[0] in (0x32, 0x33) and each[12] & 1]
    assert stalled[0][13] & 1 == 1
    # Every sonar has fired since.
    time.sleep(0.6)
    link.drain()
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
    until(lambda: firmware.timed_out)
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
