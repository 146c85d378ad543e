"""P3-DX models of a scene, found by their wheels: dimensions, wheel odometry and sonars."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.coppeliasim.poses import bounds, pose_of
from observer.geometry import Float64Array, Pose, along_arc
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.types import Odometry

MODEL = "p3dx-sh"
LEFT_MOTOR, RIGHT_MOTOR = "leftMotor", "rightMotor"
# Metres, of the simulator's own model; for wheels whose shape cannot be measured.
USUAL_RADIUS_M = 0.0975
_PLAUSIBLE_RADIUS_M = (0.02, 0.5)
_SHORT_PATH = 1


@dataclass(frozen=True, eq=False)
class Pioneer:
    """A robot with two driven wheels.

    Attributes:
        handle, path, name: of the model's base in the scene.
        left, right: handles of its motors.
        wheel_radius_m, track_m: measured; the track between the wheels' middles.
        T_robot_base: its base frame in the model's axes, which may point anywhere.
        centre: (3,) metres, middle of its bounding box in the base frame.
        size: (3,) metres, length, width, height.
    """

    handle: int
    path: str
    name: str
    left: int
    right: int
    wheel_radius_m: float
    track_m: float
    T_robot_base: Pose
    centre: Float64Array
    size: Float64Array

    def T_room_base(self, connection: Connection) -> Pose:
        """Ask for the current pose of its base in the room."""
        return pose_of(connection, self.handle) @ self.T_robot_base

    def wheel_angles(self, connection: Connection) -> tuple[float, float]:
        """Ask for the angles of the left and the right wheel, radians."""
        left, right = (connection.number("getJointPosition", j) for j in (self.left, self.right))
        return left, right


class WheelOdometry:
    """Odometry from the angles of two wheels; the motion between readings is an arc."""

    def __init__(self, radius_m: float, track_m: float) -> None:
        self._radius, self._track = radius_m, track_m
        self._before: tuple[float, float] | None = None
        self._x = self._y = self._yaw = 0.0

    def add(self, left_rad: float, right_rad: float) -> Odometry:
        """Add the wheels' current angles; the first ones are the origin."""
        before, self._before = self._before, (left_rad, right_rad)
        if before is not None:
            left, right = left_rad - before[0], right_rad - before[1]
            distance = (left + right) / 2 * self._radius
            turn = (right - left) * self._radius / self._track
            self._x, self._y = along_arc(self._x, self._y, self._yaw, distance, turn)
            self._yaw += turn
        return Odometry(self._x, self._y, self._yaw)

    def rebase(self) -> None:
        """Ignore the step to the next angles, because the joints were reset."""
        self._before = None


@dataclass(frozen=True)
class Sonar:
    """A proximity sensor: its handle, and its position and direction in the base frame.

    The simulator itself updates it at every step.
    """

    handle: int
    x: float
    y: float
    heading: float


def find_sonars(connection: Connection, robot: Pioneer) -> tuple[Sonar, ...]:
    """Find a robot's sonars, in the scene's order; a sensor looks along its own z axis."""
    T_base_room = robot.T_room_base(connection).inverse()
    found = []
    for handle in connection.objects("proximitysensor", robot.handle):
        T_base_sensor = T_base_room @ pose_of(connection, handle)
        x, y, _ = T_base_sensor.translation.tolist()
        ahead = T_base_sensor.rotation[:, 2].tolist()
        found.append(Sonar(handle, x, y, math.atan2(ahead[1], ahead[0])))
    return tuple(found)


def read_sonar(connection: Connection, index: int, sonar: Sonar, received: float) -> SonarReading:
    """Read the newest echo; ``received`` is the host's monotonic clock."""
    result = connection.call("readProximitySensor", sonar.handle)
    values: Sequence[object] = result if isinstance(result, tuple) else (result, None)
    distance = float(connection.finite([values[1]], 1)[0]) if values[0] == 1 else None
    return SonarReading(index, sonar.x, sonar.y, sonar.heading, distance, received)


def find_pioneers(connection: Connection) -> list[Pioneer]:
    """Find every object of the scene that has motors of these names directly below it."""
    motors: dict[int, dict[str, int]] = {}
    for handle in connection.objects("joint"):
        alias = connection.call("getObjectAlias", handle)
        if alias in (LEFT_MOTOR, RIGHT_MOTOR):
            base = int(connection.call("getObjectParent", handle))
            motors.setdefault(base, {})[alias] = handle
    return [
        _measured(connection, base, found[LEFT_MOTOR], found[RIGHT_MOTOR])
        for base, found in sorted(motors.items())
        if base >= 0 and len(found) == 2
    ]


def find_pioneer(connection: Connection, path: str) -> Pioneer:
    """Find the robot at a path of the scene.

    Raises:
        CoppeliaSimError: there is none; the sentence lists the existing ones.
    """
    handle = connection.call("getObject", path, {"noError": True})
    found = find_pioneers(connection)
    for robot in found:
        if robot.handle == handle:
            return robot
    listed = ", ".join(robot.path for robot in found) or "none"
    raise CoppeliaSimError(
        f"the scene of CoppeliaSim at {connection.address} has no P3-DX {path} with "
        f"{LEFT_MOTOR} and {RIGHT_MOTOR}; there are: {listed}"
    )


def own_scripts(connection: Connection, robot: int) -> list[int]:
    """Return the handles of scripts that drive a model; the stock model has one."""
    try:
        connection.constant("sceneobject_script", "object_script_type")
    except CoppeliaSimError:
        # Before version 4.8 scripts were not objects of the scene.
        kind = connection.constant("scripttype_childscript", "scripttype_simulation")
        script = int(connection.call("getScript", kind, robot))
        return [] if script < 0 else [script]
    return connection.objects("script", robot)


def _measured(connection: Connection, base: int, left: int, right: int) -> Pioneer:
    T_room_robot = pose_of(connection, base)
    at_left, at_right = (pose_of(connection, joint).translation for joint in (left, right))
    across = at_left - at_right
    # The model stands on level ground, but its own axes may point anywhere.
    across[2] = 0.0
    track = float(np.linalg.norm(across))
    path = str(connection.call("getObjectAlias", base, _SHORT_PATH))
    if track < 1e-3:
        raise CoppeliaSimError(
            f"{path} of CoppeliaSim at {connection.address} has both wheels in the same place; set "
            "it upright"
        )
    radius = _wheel_radius(connection, left)
    y, z = across / track, np.array([0.0, 0.0, 1.0])
    middle = (at_left + at_right) / 2 - radius * z
    T_robot_base = T_room_robot.inverse() @ Pose(np.stack([np.cross(y, z), y, z], axis=1), middle)
    centre, size = _outline(connection, base, T_robot_base)
    # The path's last part, since two robots may share an alias.
    name = path.rpartition("/")[2]
    return Pioneer(base, path, name, left, right, radius, track, T_robot_base, centre, size)


def _wheel_radius(connection: Connection, joint: int) -> float:
    """Half the larger extent of the shape below the joint, which is the wheel."""
    with contextlib.suppress(CoppeliaSimError):
        for wheel in connection.objects("shape", joint, 1):
            lower, upper = bounds(connection, wheel, model=False)
            radius = float((upper - lower).max()) / 2
            if _PLAUSIBLE_RADIUS_M[0] < radius < _PLAUSIBLE_RADIUS_M[1]:
                return radius
    if connection.closed:
        # Nothing could be measured because the simulator is gone; this call raises.
        connection.call("getSimulationTime")
    return USUAL_RADIUS_M


def _outline(
    connection: Connection, base: int, T_robot_base: Pose
) -> tuple[Float64Array, Float64Array]:
    """Middle and size (3,) of the bounding box in the base frame, metres."""
    with contextlib.suppress(CoppeliaSimError):
        lower, upper = bounds(connection, base, model=True)
        corners = np.stack(np.meshgrid(*zip(lower, upper, strict=True)), axis=-1).reshape(-1, 3)
        corners = T_robot_base.inverse().apply(corners)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if ((high - low) > 0.05).all() and ((high - low) < 3.0).all():
            return (low + high) / 2, high - low
    if connection.closed:
        connection.call("getSimulationTime")
    spec = robot_spec(MODEL)
    size = np.array([spec.length_m, spec.width_m, 0.237])
    return np.array([0.0, 0.0, size[2] / 2]), size
