"""A robot's proximity sensors, which the simulator handles itself at every step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from observer.coppeliasim.connection import Connection
from observer.coppeliasim.pioneers import Pioneer
from observer.coppeliasim.poses import handles, number, pose_of
from observer.robots.contract import SonarReading


@dataclass(frozen=True)
class Sonar:
    """One sensor: its handle, and its place and direction in the base frame."""

    handle: int
    x: float
    y: float
    heading: float


def find_sonars(connection: Connection, robot: Pioneer) -> tuple[Sonar, ...]:
    """In the order of the scene; a sensor looks along its own z axis."""
    kind = connection.constant("sceneobject_proximitysensor", "object_proximitysensor_type")
    T_base_room = robot.T_room_base(connection).inverse()
    found = []
    for handle in handles(connection.call("getObjectsInTree", robot.handle, kind, 0)):
        T_base_sensor = T_base_room @ pose_of(connection, handle)
        x, y, _ = T_base_sensor.translation.tolist()
        ahead = T_base_sensor.rotation[:, 2].tolist()
        found.append(Sonar(handle, x, y, math.atan2(ahead[1], ahead[0])))
    return tuple(found)


def read_sonar(connection: Connection, index: int, sonar: Sonar, received: float) -> SonarReading:
    """Its newest echo; ``received`` is the host's monotonic clock."""
    result = connection.call("readProximitySensor", sonar.handle)
    values: Sequence[object] = result if isinstance(result, tuple) else (result, None)
    echoed = values[0] == 1
    distance = number(values[1], connection) if echoed else None
    return SonarReading(index, sonar.x, sonar.y, sonar.heading, distance, received)
