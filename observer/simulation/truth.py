"""Ground truth of the simulated lab, in the frame that a method can know.

World frame: the rectified left camera at time 0, see ``world``.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from observer.geometry import Pose
from observer.simulation.visibility import VisiblePart, visible_parts
from observer.simulation.world import Body, World
from observer.truth.contract import TrueBody

# Several readers ask for the same recent instant; none asks for one further back than this.
_REMEMBERED_INSTANTS = 32


class SimulatedTruth:
    """True states of the observer and of every obstacle, exact at any time."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._remembered = lru_cache(_REMEMBERED_INSTANTS)(self._bodies)

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        """Return the observer first, then the obstacles, at ``time`` seconds."""
        # The restart count is part of the key: driven robots move differently after a restart.
        return self._remembered(self._world.beginnings, time)

    def camera_pose(self, time: float) -> Pose:
        """Return ``T_world_camera`` of the rectified left camera."""
        return self._world.T_world_camera(time)

    def _bodies(self, _: int, time: float) -> tuple[TrueBody, ...]:
        seen = visible_parts(self._world, time)
        obstacles = (self._state(body, time, seen[body.id]) for body in self._world.obstacles)
        return (self._state(self._world.observer, time, None), *obstacles)

    def _state(self, body: Body, time: float, seen: VisiblePart | None) -> TrueBody:
        T_world_room = self._world.T_world_room
        state = body.motion.state(time)
        T_world_body = T_world_room @ body.T_room_body(time)
        heading = T_world_body.rotate(np.array([1.0, 0.0, 0.0]))
        return TrueBody(
            id=body.id,
            name=body.name,
            role=body.role,
            position=T_world_body.apply(body.centre),
            velocity=T_world_room.rotate(np.array([state.vx, state.vy, 0.0])),
            size=np.array(body.size),
            yaw=math.atan2(float(heading[0]), float(heading[2])),
            visible=None if seen is None else seen.share,
            commanded_speed=body.motion.commanded_speed(time),
            box_px=None if seen is None else seen.box_px,
            kind="robot" if body.person is None else "person",
        )
