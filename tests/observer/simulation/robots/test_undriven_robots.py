"""Robots of a simulated world before anybody drives them."""

from __future__ import annotations

import threading
import time
from contextlib import closing

import numpy as np
import pytest

from observer.opening import OpenedSource, open_source
from observer.simulation.robots.world_robots import SimulatedRobots
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World

from .lab import RATE, SCENE, Lab, Link, MakeLab


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
