"""The functions of ``sim`` that the stand-in implements."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from stand_in_picture import Painter
from stand_in_scene import (
    AXIS_FLAG,
    HANDLE_ALL,
    HANDLE_SCENE,
    JOINT,
    PAUSED,
    PROXIMITY,
    SHAPE,
    STOPPED,
    VISION,
    Refused,
    Scene,
)

from observer.geometry import Pose

# Where the simulator's own models are, named as in its documentation.
PIONEER_MODEL = "models/robots/mobile/pioneer p3dx.ttm"
ROOM_X, ROOM_Y = (-2.2, 5.4), (-3.2, 3.2)
# The simulated lab's camera on its observer, whose base is at the origin.
BASELINE_M, FORWARD_M, HEIGHT_M, TILT_DEG = 0.12, 0.07, 0.40, 5.0


class Functions:
    """One method per function, named ``sim_`` plus its name without ``sim.``."""

    def __init__(self, scene: str) -> None:
        self.scene = Scene()
        self.painter = Painter(self.scene, furnished=scene == "lab")
        if scene == "lab":
            self._furnish()

    def names(self) -> list[str]:
        return [n[4:] for n, _ in inspect.getmembers(self, callable) if n.startswith("sim_")]

    def find(self, name: str) -> Callable[..., Any] | None:
        found: Callable[..., Any] | None = getattr(self, f"sim_{name}", None)
        return found

    def _furnish(self) -> None:
        """Add the observer with its cameras, and the obstacle that crosses in front of it."""
        scene = self.scene
        observer = scene.add_pioneer(0.02, 0.0, 0.0)
        scene.add_pioneer(2.52, 0.76, -math.pi / 2)
        sensors = [
            scene.add_sensor(name, observer, self._mounted(observer, side))
            for name, side in (("leftCamera", 0.5), ("rightCamera", -0.5))
        ]
        for sensor in sensors:
            self.painter.picture(sensor)

    def _mounted(self, observer: int, side: float) -> Pose:
        t = math.radians(TILT_DEG)
        down = Pose.from_rotvec([0, t, 0], np.zeros(3)).rotation
        ahead = down @ np.array([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]])
        above_axle = Pose(ahead, np.array([FORWARD_M, side * BASELINE_M, HEIGHT_M]))
        return self.scene.room_pose(observer).inverse() @ above_axle

    # ------------------------------------------------------------------ time

    def sim_getSimulationTime(self) -> float:
        return self.scene.time

    def sim_getSimulationTimeStep(self) -> float:
        return self.scene.time_step

    def sim_getSimulationState(self) -> int:
        return self.scene.state

    def sim_startSimulation(self) -> None:
        self.scene.start()

    def sim_pauseSimulation(self) -> None:
        if self.scene.state != STOPPED:
            self.scene.state = PAUSED

    def sim_stopSimulation(self, wait: bool = False) -> None:  # noqa: ARG002
        self.scene.ask_to_stop()

    # ------------------------------------------------------------------ objects

    def sim_getObject(self, path: str, options: dict[str, Any] | None = None) -> int:
        for handle in self.scene.things:
            if path in (self.scene.path(handle), f"/{self.scene.things[handle].alias}"):
                return handle
        if (options or {}).get("noError"):
            return -1
        raise Refused("Object does not exist. (in function 'sim.getObject')")

    def sim_getObjectsInTree(
        self, base: int, kind: int = HANDLE_ALL, options: int = 0
    ) -> list[int]:
        scene = self.scene
        if base == HANDLE_SCENE:
            found = list(scene.things)
        else:
            scene.thing(base, "getObjectsInTree")
            found = scene.tree(base)[options & 1 :]
        return [h for h in found if kind in (HANDLE_ALL, scene.things[h].kind)]

    def sim_getObjectAlias(self, handle: int, options: int = -1) -> str:
        thing = self.scene.thing(handle, "getObjectAlias")
        return self.scene.path(handle) if options in (1, 2) else thing.alias

    def sim_setObjectAlias(self, handle: int, alias: str) -> None:
        self.scene.thing(handle, "setObjectAlias").alias = alias

    def sim_getObjectParent(self, handle: int) -> int:
        return self.scene.thing(handle, "getObjectParent").parent

    def sim_setObjectParent(self, handle: int, parent: int, keep: bool = True) -> None:
        thing = self.scene.thing(handle, "setObjectParent")
        if keep:
            here = self.scene.room_pose(handle)
            above = Pose.identity() if parent < 0 else self.scene.room_pose(parent)
            thing.local = above.inverse() @ here
        thing.parent = parent

    def sim_getObjectPose(self, handle: int, relative_to: int = -1) -> list[float]:
        self.scene.thing(handle, "getObjectPose")
        pose = self.scene.room_pose(handle)
        if relative_to >= 0:
            pose = self.scene.room_pose(relative_to).inverse() @ pose
        w, x, y, z = pose.quaternion_wxyz.tolist()
        return [*pose.translation.tolist(), x, y, z, w]

    def sim_setObjectPose(self, handle: int, numbers: list[float], relative_to: int = -1) -> None:
        thing = self.scene.thing(handle, "setObjectPose")
        x, y, z, w = numbers[3:]
        pose = Pose.from_quaternion((w, x, y, z), numbers[:3])
        if relative_to >= 0:
            pose = self.scene.room_pose(relative_to) @ pose
        above = Pose.identity() if thing.parent < 0 else self.scene.room_pose(thing.parent)
        thing.local = above.inverse() @ pose

    def sim_getObjectVelocity(self, handle: int) -> tuple[list[float], list[float]]:
        flagged = bool(handle & AXIS_FLAG)
        self.scene.thing(handle & ~AXIS_FLAG, "getObjectVelocity")
        still = (np.zeros(3), np.zeros(3))
        linear, angular = self.scene.velocities.get(handle & ~AXIS_FLAG, still)
        # Without the flag the real one returns rates of Euler angles: give numbers that stand out.
        return linear.tolist(), angular.tolist() if flagged else [9.0, 9.0, 9.0]

    def sim_getObjectFloatParam(self, handle: int, parameter: int) -> float:
        thing = self.scene.thing(handle, "getObjectFloatParam")
        if parameter == 1004 and thing.kind == VISION:
            return float(thing.own["angle"])
        for first, key in ((15, "box"), (21, "modelbox")):
            if 0 <= parameter - first < 6 and key in thing.own:
                return float(thing.own[key][(parameter - first) // 3][(parameter - first) % 3])
        raise Refused("Invalid parameter. (in function 'sim.getObjectFloatParam')")

    def sim_getObjectInt32Param(self, handle: int, parameter: int) -> int:
        thing = self.scene.thing(handle, "getObjectInt32Param")
        keys = {1002: "width", 1003: "height", 1018: "perspective"}
        if thing.kind == VISION and parameter in keys:
            return int(thing.own[keys[parameter]])
        raise Refused("Invalid parameter. (in function 'sim.getObjectInt32Param')")

    def sim_setObjectInt32Param(self, handle: int, parameter: int, value: int) -> None:
        thing = self.scene.thing(handle, "setObjectInt32Param")
        keys = {1002: "width", 1003: "height", 1018: "perspective"}
        thing.own[keys.get(parameter, str(parameter))] = value

    def sim_removeObjects(self, handles: list[int]) -> None:
        for handle in handles:
            self.scene.thing(handle, "removeObjects")
            # Children of a removed object lose their parent, as in the simulator.
            for thing in self.scene.things.values():
                if thing.parent == handle:
                    thing.local, thing.parent = self.scene.room_pose(thing.handle), -1
            del self.scene.things[handle]

    def sim_removeModel(self, handle: int) -> None:
        self.scene.thing(handle, "removeModel")
        for below in self.scene.tree(handle):
            del self.scene.things[below]

    # ------------------------------------------------------------------ joints

    def sim_getJointPosition(self, handle: int) -> float:
        return float(self._joint(handle, "getJointPosition")["angle"])

    def sim_getJointVelocity(self, handle: int) -> float:
        return float(self._joint(handle, "getJointVelocity")["velocity"])

    def sim_getJointTargetVelocity(self, handle: int) -> float:
        return float(self._joint(handle, "getJointTargetVelocity")["target"])

    def sim_setJointTargetVelocity(self, handle: int, velocity: float) -> None:
        self._joint(handle, "setJointTargetVelocity")["target"] = float(velocity)

    def _joint(self, handle: int, function: str) -> dict[str, Any]:
        thing = self.scene.thing(handle, function)
        if thing.kind != JOINT:
            raise Refused(f"Object is not a joint. (in function 'sim.{function}')")
        return thing.own

    # ------------------------------------------------------------------ sensors

    def sim_readProximitySensor(self, handle: int) -> Any:
        """Cast one ray to walls and robots (as cylinders); its range is 1 m, as the model's."""
        thing = self.scene.thing(handle, "readProximitySensor")
        assert thing.kind == PROXIMITY
        pose = self.scene.room_pose(handle)
        x, y, _ = pose.translation.tolist()
        dx, dy, _ = pose.rotation[:, 2].tolist()
        found = [
            (bound - at) / along
            for at, along, bounds in ((x, dx, ROOM_X), (y, dy, ROOM_Y))
            for bound in bounds
            if along * (bound - at) > 0
        ]
        for robot in self.scene.robots():
            if robot != thing.parent:
                px, py, _ = self.scene.room_pose(robot).translation.tolist()
                along = (px - x) * dx + (py - y) * dy
                across = (px - x) * dy - (py - y) * dx
                if along > 0 and abs(across) < 0.25:
                    found.append(along - math.sqrt(0.25**2 - across**2))
        nearest = min(found)
        if nearest > 1.0:
            return 0, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0]
        return 1, nearest, [0.0, 0.0, nearest], 14, [0.0, 0.0, -1.0]

    def sim_createVisionSensor(
        self, options: int, integers: list[int], floats: list[float], *_: Any
    ) -> int:
        if len(integers) != 4 or len(floats) != 11:
            raise Refused("Invalid arguments. (in function 'sim.createVisionSensor')")
        return self.scene.add_sensor(
            "VisionSensor", -1, Pose.identity(), explicit=options & 1,
            perspective=options >> 1 & 1, width=integers[0], height=integers[1], angle=floats[2],
        )  # fmt: skip

    def sim_setExplicitHandling(self, handle: int, flags: int) -> None:
        self.scene.thing(handle, "setExplicitHandling").own["explicit"] = flags

    def sim_handleVisionSensor(self, handle: int) -> tuple[int, dict[str, Any], dict[str, Any]]:
        thing = self.scene.thing(handle, "handleVisionSensor")
        if not thing.own["explicit"]:
            raise Refused(
                "Vision sensor is not tagged for explicit handling. "
                "(in function 'sim.handleVisionSensor')"
            )
        thing.own["picture"] = self.painter.picture(handle)
        return 0, {}, {}

    def sim_getVisionSensorImg(self, handle: int, *_: Any) -> tuple[bytes, list[int]]:
        own = self.scene.thing(handle, "getVisionSensorImg").own
        black = bytes(3 * own["width"] * own["height"])
        return own.get("picture", black), [own["width"], own["height"]]

    # ------------------------------------------------------------------ building

    def sim_loadModel(self, path: str) -> int:
        if path != PIONEER_MODEL:
            raise Refused(f"File '{path}' could not be opened. (in function 'sim.loadModel')")
        return self.scene.add_pioneer(0.0, 0.0, 0.0, script=True)

    def sim_createPrimitiveShape(self, kind: int, size: list[float], options: int = 0) -> int:  # noqa: ARG002
        half = tuple(n / 2 for n in size)
        return self.scene.add(
            SHAPE, "Cuboid", -1, Pose.identity(), size=tuple(size),
            box=(tuple(-n for n in half), half),
        )  # fmt: skip

    def sim_createTexture(self, file: str, *others: Any) -> tuple[int, int, list[int]]:
        _options, _sizes, _scaling, _xyg, _fixed, resolution = others
        if file:
            raise Refused(f"File '{file}' could not be opened. (in function 'sim.createTexture')")
        plane = self.scene.add(SHAPE, "Plane", -1, Pose.identity())
        number = 900 + len(self.scene.textures)
        self.scene.textures[number] = bytes(3 * resolution[0] * resolution[1])
        return plane, number, list(resolution)

    def sim_writeTexture(self, texture: int, options: int, data: bytes, *_: Any) -> None:  # noqa: ARG002
        if len(data) != len(self.scene.textures[texture]):
            raise Refused("Invalid image data size. (in function 'sim.writeTexture')")
        self.scene.textures[texture] = data

    def sim_setShapeTexture(self, handle: int, texture: int, *_: Any) -> None:
        assert texture in self.scene.textures
        self.scene.thing(handle, "setShapeTexture").own["texture"] = texture

    def sim_setShapeColor(self, handle: int, name: Any, component: int, rgb: list[float]) -> None:  # noqa: ARG002
        self.scene.thing(handle, "setShapeColor").own["color"] = rgb
