"""Images of the stand-in's scene, drawn by the simulated lab's own renderer."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from stand_in_scene import SHAPE, Scene

from observer.geometry import Pose
from observer.simulation.batches import View
from observer.simulation.motion import PlanarState
from observer.simulation.rendering import Renderer
from observer.simulation.scenarios import Scenario, load_scenario
from observer.simulation.world import World

_R_SENSOR_CAMERA = np.diag([-1.0, -1.0, 1.0])


class _Driven:
    """A robot's motion: where its wheels have taken it so far."""

    def __init__(self, scene: Scene, robot: int) -> None:
        self._scene, self._robot = scene, robot

    def state(self, time: float) -> PlanarState:  # noqa: ARG002
        pose = self._scene.room_pose(self._robot)
        x, y, _ = pose.translation.tolist()
        ahead = pose.rotation[:, 0].tolist()
        return PlanarState(x, y, math.atan2(ahead[1], ahead[0]))

    def commanded_speed(self, time: float) -> float:  # noqa: ARG002
        return 0.0


class Painter:
    """Draws what a vision sensor sees: the lab, the scene's boxes and all robots but its own."""

    def __init__(self, scene: Scene, *, furnished: bool) -> None:
        self._scene = scene
        self._furnished = furnished
        self._renderers: dict[Any, Renderer] = {}

    def picture(self, sensor: int) -> bytes:
        """Return RGB, bottom row first."""
        scene, own = self._scene, self._scene.things[sensor].own
        width, height = own["width"], own["height"]
        f = max(width, height) / 2 / math.tan(own["angle"] / 2)
        view = View(width, height, f, f, (width - 1) / 2, (height - 1) / 2, (0, height))
        image = np.empty((height, width, 3), np.uint8)
        T_room_camera = scene.room_pose(sensor) @ Pose(_R_SENSOR_CAMERA, np.zeros(3))
        self._renderer(sensor).draw(view, T_room_camera, 0.0, image)
        return image[::-1, :, ::-1].tobytes()

    def _renderer(self, sensor: int) -> Renderer:
        scene = self._scene
        above, handle = set(), sensor
        while handle >= 0:
            above.add(handle)
            handle = scene.things[handle].parent
        robots = tuple(r for r in scene.robots() if r not in above)
        boxes = tuple(sorted(h for h, t in scene.things.items() if _is_box(t)))
        found = self._renderers.get((robots, boxes))
        if found is None:
            found = self._renderers[robots, boxes] = Renderer(self._world(robots, boxes))
        return found

    def _world(self, robots: tuple[int, ...], boxes: tuple[int, ...]) -> World:
        lab = load_scenario("lab")
        objects = [o.model_dump() for o in lab.objects if self._furnished or o.kind == "poster"]
        for box in boxes:
            pose, size = self._scene.room_pose(box), self._scene.things[box].own["size"]
            x, y, z = pose.translation.tolist()
            ahead = pose.rotation[:, 0].tolist()
            objects.append({
                "kind": "crate", "x": x, "y": y, "size": list(size),
                "heading_deg": math.degrees(math.atan2(ahead[1], ahead[0])),
                "above_m": max(0.0, z - size[2] / 2),
            })  # fmt: skip
        parked = lab.robots[0].model_dump() | {"motion": None, "x": 1.0, "y": 0.0}
        given = lab.model_dump() | {
            "objects": objects,
            "robots": [parked | {"y": 0.1 * k} for k in range(len(robots))],
            "observer": {},
        }
        world = World(Scenario.model_validate(given))
        driven = iter(robots)
        world.bodies = tuple(
            replace(b, motion=_Driven(self._scene, next(driven))) if b.role == "obstacle" else b
            for b in world.bodies
        )
        return world


def _is_box(thing: Any) -> bool:
    """Return whether it is a box; floor and walls are drawn with the lab."""
    size = thing.own.get("size")
    return thing.kind == SHAPE and size is not None and max(size) < 1.5 and min(size) > 0.05
