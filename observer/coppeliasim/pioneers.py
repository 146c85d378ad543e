"""The P3-DX models of a scene: found by their wheels, which are measured."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import numpy as np

from observer.coppeliasim.connection import Connection, CoppeliaSimError
from observer.coppeliasim.poses import bounds, handles, number, pose_of
from observer.geometry import Float64Array, Pose
from observer.robots.models import robot_spec

MODEL = "p3dx-sh"
LEFT_MOTOR, RIGHT_MOTOR = "leftMotor", "rightMotor"
# Of the simulator's own model, for wheels whose shape cannot be measured.
USUAL_RADIUS_M = 0.0975
_PLAUSIBLE_RADIUS_M = (0.02, 0.5)
_SHORT_PATH = 1


@dataclass(frozen=True, eq=False)
class Pioneer:
    """A robot with two driven wheels.

    Attributes:
        handle, path, name: of the model's base in the scene.
        left, right: handles of its motors.
        wheel_radius_m, track_m: measured, between the wheels' middles.
        T_robot_base: its base in the axes of its model, which need not be those of a robot.
        centre: (3,) metres, middle of its outline in the base frame.
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
        """Where it stands at this moment."""
        return pose_of(connection, self.handle) @ self.T_robot_base

    def wheel_angles(self, connection: Connection) -> tuple[float, float]:
        """How far the left and the right wheel have turned, radians."""
        left, right = (connection.call("getJointPosition", j) for j in (self.left, self.right))
        return number(left, connection), number(right, connection)


def find_pioneers(connection: Connection) -> list[Pioneer]:
    """Every object of the scene that has motors of these names directly below it."""
    joint = connection.constant("sceneobject_joint", "object_joint_type")
    scene = connection.constant("handle_scene")
    motors: dict[int, dict[str, int]] = {}
    for handle in handles(connection.call("getObjectsInTree", scene, joint, 0)):
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
    """The robot at a path of the scene.

    Raises:
        CoppeliaSimError: there is none; the sentence lists those that are.
    """
    handle = connection.call("getObject", path, {"noError": True})
    found = find_pioneers(connection)
    for robot in found:
        if robot.handle == handle:
            return robot
    listed = ", ".join(robot.path for robot in found) or "none at all"
    raise CoppeliaSimError(
        f"the scene of CoppeliaSim at {connection.address} has no P3-DX {path} with "
        f"{LEFT_MOTOR} and {RIGHT_MOTOR}; there are: {listed}"
    )


def own_scripts(connection: Connection, robot: int) -> list[int]:
    """Handles of the scripts that drive a model by themselves, as the simulator's own does."""
    try:
        kind = connection.constant("sceneobject_script", "object_script_type")
    except CoppeliaSimError:
        # Before version 4.8 a script was no object of the scene.
        kind = connection.constant("scripttype_childscript", "scripttype_simulation")
        script = int(connection.call("getScript", kind, robot))
        return [] if script < 0 else [script]
    return handles(connection.call("getObjectsInTree", robot, kind, 0))


def _measured(connection: Connection, base: int, left: int, right: int) -> Pioneer:
    T_room_robot = pose_of(connection, base)
    at_left, at_right = (pose_of(connection, joint).translation for joint in (left, right))
    across = at_left - at_right
    # The model stands on a level floor; its own axes are not relied upon.
    across[2] = 0.0
    track = float(np.linalg.norm(across))
    path = str(connection.call("getObjectAlias", base, _SHORT_PATH))
    if track < 1e-3:
        raise CoppeliaSimError(
            f"{path} of CoppeliaSim at {connection.address} has its wheels in one place; "
            f"stand it on its wheels"
        )
    radius = _wheel_radius(connection, left)
    y, z = across / track, np.array([0.0, 0.0, 1.0])
    middle = (at_left + at_right) / 2 - radius * z
    T_robot_base = T_room_robot.inverse() @ Pose(np.stack([np.cross(y, z), y, z], axis=1), middle)
    centre, size = _outline(connection, base, T_robot_base)
    # Its path without the slash: two of them have one alias.
    name = path.rpartition("/")[2]
    return Pioneer(base, path, name, left, right, radius, track, T_robot_base, centre, size)


def _wheel_radius(connection: Connection, joint: int) -> float:
    """Half the wheel's larger extent; what belongs to the joint's shape is the wheel."""
    shape = connection.constant("sceneobject_shape", "object_shape_type")
    with contextlib.suppress(CoppeliaSimError):
        for wheel in handles(connection.call("getObjectsInTree", joint, shape, 1)):
            lower, upper = bounds(connection, wheel, model=False)
            radius = float((upper - lower).max()) / 2
            if _PLAUSIBLE_RADIUS_M[0] < radius < _PLAUSIBLE_RADIUS_M[1]:
                return radius
    if connection.closed:
        # Not a wheel without measures, but a simulator that is gone.
        connection.call("getSimulationTime")
    return USUAL_RADIUS_M


def _outline(
    connection: Connection, base: int, T_robot_base: Pose
) -> tuple[Float64Array, Float64Array]:
    """Middle and size in the base frame."""
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
