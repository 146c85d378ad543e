"""The scene of the CoppeliaSim stand-in: a tree of objects, and wheels that drive robots.

Arguments and results of the functions of ``sim`` follow the simulator's reference.
"""

from __future__ import annotations

import copy
import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from observer.geometry import Pose

SHAPE, JOINT, DUMMY, PROXIMITY, VISION, SCRIPT = 0, 1, 4, 5, 9, 12
HANDLE_SCENE, HANDLE_WORLD, HANDLE_ALL = -12, -1, -2
AXIS_FLAG = 4194304
STOPPED, PAUSED, ADVANCING, RUNNING, ABOUT_TO_STOP, LAST = 0, 8, 16, 17, 21, 23
NO_OBJECT = "Object does not exist."

CONSTANTS: dict[str, Any] = {
    "handle_scene": HANDLE_SCENE, "handle_world": HANDLE_WORLD, "handle_all": HANDLE_ALL,
    "handleflag_axis": AXIS_FLAG,
    "object_shape_type": SHAPE, "object_joint_type": JOINT, "object_dummy_type": DUMMY,
    "object_visionsensor_type": VISION, "object_proximitysensor_type": PROXIMITY,
    "sceneobject_script": SCRIPT,
    "simulation_stopped": STOPPED, "simulation_paused": PAUSED,
    "simulation_advancing": ADVANCING, "simulation_advancing_running": RUNNING,
    "simulation_advancing_abouttostop": ABOUT_TO_STOP,
    "simulation_advancing_lastbeforestop": LAST,
    "visionintparam_resolution_x": 1002, "visionintparam_resolution_y": 1003,
    "visionfloatparam_perspective_angle": 1004, "visionintparam_perspective_operation": 1018,
    "primitiveshape_cuboid": 3, "primitiveshape_plane": 1,
    "shapeintparam_static": 3003, "shapeintparam_respondable": 3004,
    "texturemap_cube": 3, "texturemap_plane": 0, "colorcomponent_ambient_diffuse": 0,
    **{
        f"objfloatparam_{kind}_{end}_{axis}": first + 3 * k + n
        for kind, first in (("objbbox", 15), ("modelbbox", 21))
        for k, end in enumerate(("min", "max"))
        for n, axis in enumerate("xyz")
    },
}  # fmt: skip


class Refused(Exception):
    """An error that the simulator raises in Lua."""


@dataclass
class Thing:
    """An object of the scene; ``own`` holds what is specific to its kind."""

    handle: int
    kind: int
    alias: str
    parent: int = -1
    local: Pose = field(default_factory=Pose.identity)
    own: dict[str, Any] = field(default_factory=dict)


class Scene:
    """Objects, simulated time and the motion of every two-wheeled robot."""

    time_step = 0.05

    def __init__(self) -> None:
        self.things: dict[int, Thing] = {}
        self.time = 0.0
        self.state = STOPPED
        self._handles = itertools.count(14)
        self._before: dict[int, Thing] = {}
        self.velocities: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self.textures: dict[int, bytes] = {}

    # ------------------------------------------------------------------ the tree

    def add(self, kind: int, alias: str, parent: int, local: Pose, **own: Any) -> int:
        handle = next(self._handles)
        self.things[handle] = Thing(handle, kind, alias, parent, local, own)
        return handle

    def thing(self, handle: Any, function: str = "") -> Thing:
        found = self.things.get(handle)
        if found is None:
            raise Refused(f"{NO_OBJECT} (in function 'sim.{function}')")
        return found

    def room_pose(self, handle: int) -> Pose:
        thing = self.things[handle]
        return thing.local if thing.parent < 0 else self.room_pose(thing.parent) @ thing.local

    def tree(self, base: int) -> list[int]:
        below = [t.handle for t in self.things.values() if t.parent == base]
        return [base, *itertools.chain.from_iterable(self.tree(h) for h in below)]

    def path(self, handle: int) -> str:
        thing = self.things[handle]
        alike = [
            t.handle
            for t in self.things.values()
            if t.alias == thing.alias and t.parent == thing.parent
        ]
        index = alike.index(handle)
        above = "" if thing.parent < 0 else self.path(thing.parent)
        return f"{above}/{thing.alias}" + (f"[{index}]" if index else "")

    # ------------------------------------------------------------------ time

    def start(self) -> None:
        if self.state == STOPPED:
            self._before = copy.deepcopy(self.things)
            self.time = 0.0
        self.state = RUNNING

    def ask_to_stop(self) -> None:
        """Request a stop, which the main loop carries out in its next pass."""
        if self.state != STOPPED:
            self.state = ABOUT_TO_STOP

    def stop(self) -> None:
        if self.state != STOPPED:
            # Undo whatever was created or moved during the simulation.
            self.things, self._before = self._before, {}
            self.velocities = {}
            self.time = 0.0
        self.state = STOPPED

    def advance(self) -> None:
        dt = self.time_step
        for robot in self.robots():
            thing = self.things[robot]
            left, right = (self.things[h] for h in self.motors(robot))
            radius, track = thing.own["radius"], thing.own["track"]
            for joint in (left, right):
                joint.own["velocity"] = joint.own["target"]
                joint.own["angle"] += joint.own["velocity"] * dt
            speed = radius * (left.own["velocity"] + right.own["velocity"]) / 2
            rate = radius * (right.own["velocity"] - left.own["velocity"]) / track
            half = rate * dt / 2
            chord = speed * dt * (math.sin(half) / half if half else 1.0)
            # It turns about the middle of the axle, which is not the model's origin.
            T_robot_axle = Pose(np.eye(3), np.array([thing.own["axle_x"], 0.0, 0.0]))
            turned = Pose.from_rotvec(
                [0, 0, rate * dt], [chord * math.cos(half), chord * math.sin(half), 0.0]
            )
            before = thing.local
            thing.local = before @ T_robot_axle @ turned @ T_robot_axle.inverse()
            self.velocities[robot] = (
                (thing.local.translation - before.translation) / dt,
                np.array([0.0, 0.0, rate]),
            )
        self.time += dt

    def robots(self) -> list[int]:
        return [h for h, t in self.things.items() if "radius" in t.own]

    def motors(self, robot: int) -> tuple[int, int]:
        below = {t.alias: t.handle for t in self.things.values() if t.parent == robot}
        return below["leftMotor"], below["rightMotor"]

    # ------------------------------------------------------------------ what models there are

    def add_pioneer(self, x: float, y: float, heading: float, *, script: bool = False) -> int:
        """Add one built like the simulator's own model: origin high up, wheel centres below it."""
        up, radius, track, axle_x = 0.1388, 0.0975, 0.331, -0.02
        robot = self.add(
            SHAPE, "PioneerP3DX", -1, Pose.from_rotvec([0, 0, heading], [x, y, up]),
            radius=radius, track=track, axle_x=axle_x,
            modelbox=((-0.25, -0.2, -up), (0.21, 0.2, 0.1)),
        )  # fmt: skip
        # A joint turns about its own z axis, which points to the left.
        across = Pose.from_rotvec([-math.pi / 2, 0, 0], np.zeros(3)).rotation
        for alias, side in (("leftMotor", 0.5), ("rightMotor", -0.5)):
            at = np.array([axle_x, side * track, radius - up])
            joint = self.add(
                JOINT, alias, robot, Pose(across, at), angle=0.0, velocity=0.0, target=0.0
            )
            self.add(
                SHAPE, alias.replace("Motor", "Wheel"), joint, Pose.identity(),
                box=((-radius, -radius, -0.02), (radius, radius, 0.02)),
            )  # fmt: skip
        for degrees in (90, 50, 30, 10, -10, -30, -50, -90):
            a = math.radians(degrees)
            # The sensor looks along its z axis.
            ahead = Pose.from_rotvec([0, 0, a], np.zeros(3)).rotation @ np.array(
                [[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]]
            )
            self.add(
                PROXIMITY, "ultrasonicSensor", robot,
                Pose(ahead, np.array([0.15 * math.cos(a), 0.15 * math.sin(a), 0.07])),
            )  # fmt: skip
        if script:
            self.add(SCRIPT, "Script", robot, Pose.identity())
        return robot

    def add_sensor(self, alias: str, parent: int, local: Pose, **own: Any) -> int:
        given = {"width": 512, "height": 256, "angle": math.radians(60.0), "perspective": 1}
        return self.add(VISION, alias, parent, local, **{**given, "explicit": 0, **own})
