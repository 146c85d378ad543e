"""Opens a simulator's scene: images, ground truth, robots."""

from __future__ import annotations

from collections.abc import Sequence

from observer.coppeliasim.address import Address, parse_address
from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.coppeliasim.pioneers import MODEL, Pioneer, find_pioneers
from observer.coppeliasim.sensors import Sensor, create_sensors, find_sensors
from observer.coppeliasim.source import CoppeliaSimSource
from observer.coppeliasim.truth import CoppeliaSimTruth
from observer.rig.rig import Role
from observer.robots.contract import RobotPort


class CoppeliaSimRobots:
    """The scene's robots: the one that carries the cameras, and the first of the others."""

    def __init__(self, address: Address, robots: Sequence[tuple[Role, Pioneer]]) -> None:
        self._robots = tuple(robots)
        self.world = address.world

    def serve(self) -> tuple[RobotPort, ...]:
        """Return the robots' ports, reachable as long as the simulator is."""
        first: dict[Role, Pioneer] = {}
        for role, robot in self._robots:
            first.setdefault(role, robot)
        return tuple(
            RobotPort(role, f"{self.world}{robot.path}", MODEL, robot.name)
            for role, robot in first.items()
        )

    def close(self) -> None:
        """Release nothing: the robots are the simulator's."""


def open_coppeliasim(
    text: str,
) -> tuple[CoppeliaSimSource, CoppeliaSimTruth, CoppeliaSimRobots]:
    """Open the scene of the simulator at ``HOST:PORT`` (see ``parse_address``).

    A scene without a stereo pair gets one, mounted on its first robot.

    Raises:
        SourceError: the address is malformed, nothing answers there, or the scene has neither a
            stereo pair nor a robot to mount one on.
    """
    connection = Connection(parse_address(text))
    try:
        pioneers = find_pioneers(connection)
        sensors = find_sensors(connection)
        if sensors is None:
            if not pioneers:
                raise CoppeliaSimError(
                    f"the scene of CoppeliaSim at {connection.address} has neither two vision "
                    "sensors side by side nor a P3-DX to mount them on; build a scene with: "
                    f"dynamic-observer coppelia-scene {connection.address}"
                )
            sensors = create_sensors(connection, pioneers[0])
        robots = _with_roles(connection, pioneers, sensors.left)
        observer = next((robot for role, robot in robots if role == "observer"), None)
        truth = CoppeliaSimTruth(robots, sensors.calibration)
        source = CoppeliaSimSource(connection, sensors, observer, truth)
    except BaseException:
        connection.close()
        raise
    return source, truth, CoppeliaSimRobots(connection.address, robots)


def _with_roles(
    connection: Connection, pioneers: Sequence[Pioneer], left: Sensor
) -> list[tuple[Role, Pioneer]]:
    """Assign roles; the observer, which carries the left sensor, comes first."""
    above = set()
    handle = int(connection.call("getObjectParent", left.handle))
    while handle >= 0 and handle not in above:
        above.add(handle)
        handle = int(connection.call("getObjectParent", handle))
    carriers = [robot for robot in pioneers if robot.handle in above][:1]
    roles: list[tuple[Role, Pioneer]] = [("observer", robot) for robot in carriers]
    return roles + [("obstacle", robot) for robot in pioneers if robot not in carriers]
