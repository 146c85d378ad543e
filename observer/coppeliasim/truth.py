"""Ground truth of CoppeliaSim's scene at the instants of frames.

The simulator knows only its present state, so the source records it with every frame. World frame:
the rectified left camera at the first frame.
"""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from observer.camera import StereoCalibration
from observer.coppeliasim.connection import Connection
from observer.coppeliasim.pioneers import Pioneer
from observer.geometry import Pose
from observer.truth.contract import TrueBody
from observer.vision.rectification import Rectification

# Several readers ask for the same recent instant; none asks for one further back than this.
_REMEMBERED_INSTANTS = 256


class CoppeliaSimTruth:
    """True states of the robots at the instants of frames, and at no others.

    Args:
        robots: with their roles, the observer first where there is one.
    """

    def __init__(
        self, robots: Sequence[tuple[str, Pioneer]], calibration: StereoCalibration
    ) -> None:
        self._robots = tuple(robots)
        self._T_left_camera = Pose(Rectification(calibration).R_rectified_left.T, np.zeros(3))
        self._T_world_room: Pose | None = None
        self._lock = threading.Lock()
        self._instants: OrderedDict[float, tuple[Pose, tuple[TrueBody, ...]]] = OrderedDict()

    def note(self, connection: Connection, time: float, T_room_left: Pose) -> None:
        """Record the current state under a frame's ``time``.

        Args:
            T_room_left: pose of the left camera as mounted, not rectified.
        """
        T_room_camera = T_room_left @ self._T_left_camera
        if self._T_world_room is None:
            self._T_world_room = T_room_camera.inverse()
        T_world_room = self._T_world_room
        bodies = tuple(
            _state(connection, index, role, robot, T_world_room)
            for index, (role, robot) in enumerate(self._robots)
        )
        with self._lock:
            self._instants[time] = (T_world_room @ T_room_camera, bodies)
            while len(self._instants) > _REMEMBERED_INSTANTS:
                self._instants.popitem(last=False)

    def begin_again(self) -> None:
        """Forget everything: the next frame is the first."""
        with self._lock:
            self._instants.clear()
            self._T_world_room = None

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        """Return the observer first, then the obstacles; empty if no frame has this ``time``."""
        return self._at(time)[1]

    def camera_pose(self, time: float) -> Pose | None:
        """Return ``T_world_camera`` of the rectified left camera; None without a frame."""
        return self._at(time)[0]

    def _at(self, time: float) -> tuple[Pose | None, tuple[TrueBody, ...]]:
        with self._lock:
            return self._instants.get(time, (None, ()))


def _state(
    connection: Connection, index: int, role: str, robot: Pioneer, T_world_room: Pose
) -> TrueBody:
    # Without this flag the angular part would be Euler angle rates.
    flagged = robot.handle | connection.constant("handleflag_axis")
    moving = connection.call("getObjectVelocity", flagged)
    linear, angular = (
        connection.finite(part, 3)
        for part in (moving if isinstance(moving, tuple) and len(moving) == 2 else (None, None))
    )
    T_room_base = robot.T_room_base(connection)
    T_room_robot = T_room_base @ robot.T_robot_base.inverse()
    centre = T_room_base.apply(robot.centre)
    velocity = linear + np.cross(angular, centre - T_room_robot.translation)
    ahead = T_world_room.rotate(T_room_base.rotation[:, 0])
    targets = [
        connection.number("getJointTargetVelocity", joint) for joint in (robot.left, robot.right)
    ]
    return TrueBody(
        id=index,
        name=robot.name,
        role=role,
        position=T_world_room.apply(centre),
        velocity=T_world_room.rotate(velocity),
        size=robot.size,
        yaw=math.atan2(float(ahead[0]), float(ahead[2])),
        visible=None,
        commanded_speed=sum(targets) / 2 * robot.wheel_radius_m,
        kind="robot",
    )
