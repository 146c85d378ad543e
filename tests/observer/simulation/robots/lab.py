"""A scene with served robots and a client of each."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from observer.rig.rig import Role
from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.motion import PlanarState
from observer.simulation.robots.world_robots import SimulatedRobots
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World

from ....waiting import until

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
        until(lambda: log.count != before, "the command arrives", pause_s=0.001)
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


def holding(lab: Lab, role: Role, speed: int, turn_rate: int = 0) -> Callable[[], None]:
    def say() -> None:
        lab.tell(role, Command.VEL, speed)
        lab.tell(role, Command.RVEL, turn_rate)

    return say
