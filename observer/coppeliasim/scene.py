"""Builds the scene of the paper's figure 1 in a running simulator: two P3-DX and textured boxes.

Anything built before is replaced; existing robots and cameras are kept and moved into place. So
building is idempotent.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from observer.coppeliasim.address import Address
from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.coppeliasim.pioneers import Pioneer, find_pioneers, own_scripts
from observer.coppeliasim.poses import pose_numbers
from observer.coppeliasim.sensors import create_sensors, find_sensors
from observer.geometry import Pose

# Path relative to the simulator's own folder.
PIONEER_MODEL = "models/robots/mobile/pioneer p3dx.ttm"
# Prefix of the aliases of everything else that is built.
PREFIX = "dynamicObserver"
_FLOOR = "/Floor"
_LOAD_WITHIN_S = 20.0
_BUILD_WITHIN_S = 5.0
# Metres: half the side of the simulator's own floor, and height and thickness of the walls.
_ROOM_M, _WALL_HEIGHT_M, _WALL_M = 2.5, 2.0, 0.1
_TEXTURE_PX, _TEXTURE_M = 256, 1.0
# Bits of sim.setShapeTexture: repeat in both directions.
_REPEATED = 4 | 8
# Start poses of the two robots: x, y, heading. The obstacle crosses in front of the observer.
_PLACES = ((-1.8, 0.0, 0.0), (0.7, 0.9, -math.pi / 2))
# x, y, heading, length, width, height: behind and beside the obstacle's path.
_BOXES = (
    (2.0, 1.6, 0.2, 0.6, 0.6, 0.55),
    (2.1, 0.2, -0.1, 0.45, 0.55, 0.42),
    (1.9, -1.5, 0.5, 0.5, 0.7, 0.8),
    (0.4, -1.9, -0.4, 0.42, 0.34, 0.3),
    (0.6, 2.0, 0.6, 0.45, 0.36, 0.34),
)


@dataclass(frozen=True)
class BuiltScene:
    """Contents of a scene after building.

    Attributes:
        robots: paths, the observer first. cameras: paths, left and right.
    """

    robots: tuple[str, ...]
    cameras: tuple[str, str]


def build_scene(address: Address) -> BuiltScene:
    """Build the scene in the simulator at ``address``, whose simulation is stopped.

    Raises:
        CoppeliaSimError: nothing answers there, the simulation runs, or the simulator lacks a
            model of the robot.
    """
    with closing(Connection(address)) as connection:
        return _build(connection)


def _build(connection: Connection) -> BuiltScene:
    if connection.call("getSimulationState") != connection.constant("simulation_stopped"):
        raise CoppeliaSimError(
            f"the simulation at {connection.address} is running, and anything built meanwhile is "
            "lost when it stops; stop it first"
        )
    _clear(connection)
    if connection.call("getObject", _FLOOR, {"noError": True}) < 0:
        side = 2 * _ROOM_M
        _solid(connection, "Floor", (side, side, 0.1), (0.0, 0.0, -0.05, 0.0), 1)
    _walls(connection)
    for k, (x, y, heading, length, width, height) in enumerate(_BOXES):
        at = (x, y, height / 2, heading)
        _solid(connection, f"Box{k + 1}", (length, width, height), at, 10 + k)
    for _ in range(len(_PLACES) - len(find_pioneers(connection))):
        _load_pioneer(connection)
    robots = find_pioneers(connection)[: len(_PLACES)]
    if len(robots) < len(_PLACES):
        raise CoppeliaSimError(
            f"{PIONEER_MODEL} of CoppeliaSim at {connection.address} has no leftMotor and "
            "rightMotor; load a P3-DX model that has them"
        )
    robots = _observer_first(connection, robots)
    for robot, place in zip(robots, _PLACES, strict=True):
        _place(connection, robot, place)
    sensors = find_sensors(connection) or create_sensors(connection, robots[0])
    cameras = sensors.left.path, sensors.right.path
    return BuiltScene(tuple(robot.path for robot in robots), cameras)


def _clear(connection: Connection) -> None:
    before = [
        handle
        for handle in connection.objects("shape")
        if str(connection.call("getObjectAlias", handle)).startswith(PREFIX)
    ]
    if before:
        connection.call("removeObjects", before, within_s=_BUILD_WITHIN_S)


def _load_pioneer(connection: Connection) -> None:
    try:
        model = connection.call("loadModel", PIONEER_MODEL, within_s=_LOAD_WITHIN_S)
    except CoppeliaSimError as error:
        raise CoppeliaSimError(
            f"{error}; add two P3-DX from the simulator's model browser (robots, mobile), then "
            "build the scene again"
        ) from None
    # The model's own script would drive it, too.
    scripts = own_scripts(connection, model)
    if scripts and connection.has("removeObjects"):
        connection.call("removeObjects", scripts)
    elif scripts:
        connection.call("removeScript", scripts[0])


def _observer_first(connection: Connection, robots: list[Pioneer]) -> list[Pioneer]:
    """Move the robot that carries the cameras to the front, if there is one."""
    sensors = find_sensors(connection)
    if sensors is None:
        return robots
    carrier = int(connection.call("getObjectParent", sensors.left.handle))
    return sorted(robots, key=lambda robot: robot.handle != carrier)


def _place(connection: Connection, robot: Pioneer, place: tuple[float, float, float]) -> None:
    x, y, heading = place
    T_room_base = Pose.from_rotvec([0.0, 0.0, heading], [x, y, 0.0])
    T_room_robot = T_room_base @ robot.T_robot_base.inverse()
    connection.call("setObjectPose", robot.handle, pose_numbers(T_room_robot))


def _walls(connection: Connection) -> None:
    middle, length = _ROOM_M + _WALL_M / 2, 2 * (_ROOM_M + _WALL_M)
    up = _WALL_HEIGHT_M / 2
    for k in range(4):
        angle = k * math.pi / 2
        at = (middle * math.cos(angle), middle * math.sin(angle), up, angle)
        _solid(connection, f"Wall{k + 1}", (_WALL_M, length, _WALL_HEIGHT_M), at, 2 + k)


def _solid(
    connection: Connection,
    name: str,
    size: tuple[float, float, float],
    place: tuple[float, float, float, float],
    seed: int,
) -> None:
    """Create a textured static box that cannot be driven through."""
    cuboid = connection.constant("primitiveshape_cuboid")
    handle = connection.call("createPrimitiveShape", cuboid, list(size))
    connection.call("setObjectAlias", handle, PREFIX + name)
    x, y, z, heading = place
    pose = Pose.from_rotvec([0.0, 0.0, heading], [x, y, z])
    connection.call("setObjectPose", handle, pose_numbers(pose))
    for parameter in ("shapeintparam_static", "shapeintparam_respondable"):
        connection.call("setObjectInt32Param", handle, connection.constant(parameter), 1)
    resolution = [_TEXTURE_PX, _TEXTURE_PX]
    plane, texture, _ = connection.call(
        "createTexture", "", 0, [0.1, 0.1], [1.0, 1.0], [0.0, 0.0, 0.0], 0, resolution
    )
    cube = connection.constant("texturemap_cube")
    scale = [_TEXTURE_M, _TEXTURE_M]
    connection.call("setShapeTexture", handle, texture, cube, _REPEATED, scale)
    connection.call("removeObjects", [plane])
    pattern = _pattern(seed).tobytes()
    connection.call(
        "writeTexture", texture, 0, pattern, 0, 0, *resolution, within_s=_BUILD_WITHIN_S
    )


def _pattern(seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Draw (H, W, 3) RGB patches of many sizes, so that there are corners at every distance."""
    rng = np.random.default_rng(seed)
    tint = rng.uniform(0.6, 1.0, 3)
    total = np.zeros((_TEXTURE_PX, _TEXTURE_PX))
    for cells in (8, 16, 32, 64):
        patches = rng.uniform(0.0, 1.0, (cells, cells))
        total += np.kron(patches, np.ones((_TEXTURE_PX // cells,) * 2))
    grey = 40 + 200 * total / total.max()
    return np.asarray(grey[..., None] * tint, dtype=np.uint8)
