"""Content of the scene at one moment, made from the newest messages; independent of viser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import NDArray

from app.contract.events import EngineState, ObservationEvent, StateEvent
from app.contract.robots import RobotsNow
from app.contract.status import STALE_AFTER_S
from app.contract.views import CloudHeader
from app.runtime.latest import Latest
from app.viewer.robot_marks import USUAL_GUARD, RobotMarks, robot_marks
from app.viewer.shapes import box_edges, rig_edges, upright_rotation, uprighted
from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.guard.parameters import GuardParameters
from observer.jsonl import ObstacleEntry, line_pose
from observer.mount import level_pose
from observer.obstacle_colors import obstacle_rgb
from observer.obstacle_labels import obstacle_label
from observer.truth.matching import TrueBodyEntry

# An arrow shows the obstacle's place after this time.
_ARROW_S = 1.0
_SLOWEST_ARROW_MPS = 0.03
_LABEL_ABOVE_M = 0.08
# An obstacle whose lowest seen point is higher than this does not stand on the floor.
_FOOT_M = 0.25


@dataclass(frozen=True, eq=False)
class Tag:
    """Text at a place in the world."""

    text: str
    position: Float64Array


@dataclass(frozen=True, eq=False)
class Cloud:
    """Coloured points (N, 3) in the camera frame of their own instant."""

    T_world_camera: Pose | None
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Picture:
    """Drawing of one observation, world frame, metres.

    Attributes:
        segment: (engine's generation, segment): another value means another world frame.
        boxes, truth: (N, 12, 2, 3) edges. box_colors: (N, 3) RGB, one per box.
        arrows: (N, 2, 3) start and end.
        rig: (N, 2, 3) lines from the camera to its robot.
        tags: one per obstacle.
        positions: of the obstacles by id.
        optics: vertical field of view, radians, and width per height of the image; None without a
            camera.
        robot: the observing robot, if it is connected and its position is known.
        stale: it is old although playback was not paused, so the robot is not drawn. The page says
            so, not the scene: it also knows when it is disconnected.
    """

    segment: tuple[int, int]
    T_display_world: Pose
    floor_known: bool
    T_world_camera: Pose | None
    rig: Float64Array
    optics: tuple[float, float] | None
    boxes: Float64Array
    box_colors: NDArray[np.uint8]
    truth: Float64Array
    arrows: Float64Array
    tags: tuple[Tag, ...]
    positions: Mapping[int, Float64Array] = field(default_factory=dict)
    robot: RobotMarks | None = None
    stale: bool = False


def make_picture(
    event: ObservationEvent | None,
    state: StateEvent,
    generation: int,
    now: float,
    driving: RobotsNow | None = None,
    limits: GuardParameters = USUAL_GUARD,
) -> Picture:
    """Make the picture of the newest observation, as fresh as it is at ``now``.

    Args:
        driving: state of the robots, as far as known. limits: the guard's current parameters.
    """
    mount = state.mount
    T_display_world = level_pose(mount)
    line = None if event is None else event.line
    reported = () if line is None else line["obstacles"]
    placed = [o for o in reported if o["position"] is not None]
    T_world_camera = None if line is None else line_pose(line)
    up = T_display_world.rotation.T @ np.array([0.0, 0.0, 1.0])
    return Picture(
        segment=(generation, 0 if line is None else line["segment"]),
        T_display_world=T_display_world,
        floor_known=mount is not None,
        T_world_camera=T_world_camera,
        rig=rig_edges(mount, T_world_camera),
        optics=None if state.camera is None else _optics(state.camera),
        boxes=_stacked(
            [_obstacle_edges(o, T_display_world, mount is not None) for o in placed], 12
        ),
        box_colors=np.array(
            [obstacle_rgb(o["state"], o["motion"]) for o in placed], np.uint8
        ).reshape(-1, 3),
        truth=_stacked([_true_edges(b, up) for b in (event.truth if event else [])], 12),
        arrows=_stacked([a for o in placed if (a := _arrow(o)) is not None], None),
        tags=tuple(_tag(o, up) for o in placed),
        positions={o["id"]: np.array(o["position"]) for o in placed},
        robot=robot_marks(
            None if driving is None else driving.robots["observer"],
            mount,
            T_world_camera,
            None if driving is None else driving.goal,
            limits,
        ),
        stale=_is_stale(event, state, now),
    )


def read_cloud(value: Latest) -> Cloud:
    """Read the cloud as the engine writes it: points float32 (N, 3), then colours uint8 (N, 3)."""
    header = cast(CloudHeader, value.header)
    count, matrix = header["count"], header["T_world_camera"]
    points = np.frombuffer(value.payload, np.float32, count * 3).reshape(-1, 3)
    colors = np.frombuffer(value.payload, np.uint8, count * 3, offset=points.nbytes)
    pose = None if matrix is None else Pose.from_matrix(np.reshape(matrix, (4, 4)))
    return Cloud(pose, points, colors.reshape(-1, 3))


def _is_stale(event: ObservationEvent | None, state: StateEvent, now: float) -> bool:
    if state.state is EngineState.FAILED:
        return True
    if event is None or now - event.received <= STALE_AFTER_S:
        return False
    playback = state.playback
    return playback is None or not (playback.paused or playback.ended)


def _optics(camera: StereoCamera) -> tuple[float, float]:
    fov = 2 * np.arctan(camera.height / 2 / camera.fy)
    return float(fov), camera.width / camera.height


def _obstacle_edges(
    obstacle: ObstacleEntry, T_display_world: Pose, floor_known: bool
) -> Float64Array:
    """Return the edges of an upright box, with its foot extended to the floor if that is near."""
    up = T_display_world.rotation.T @ np.array([0.0, 0.0, 1.0])
    position, size = np.array(obstacle["position"]), np.array(obstacle["size"], np.float64)
    turned = obstacle["orientation_wxyz"]
    rotation = np.eye(3) if turned is None else Pose.from_quaternion(turned, position).rotation
    foot = float(T_display_world.apply(position)[2]) - size[1] / 2
    if floor_known and 0.0 < foot < _FOOT_M:
        # In depth, feet cannot be distinguished from the floor.
        size[1] += foot
        position = position - up * foot / 2
    return box_edges(position, size, uprighted(rotation, up))


def _true_edges(body: TrueBodyEntry, up: Float64Array) -> Float64Array:
    return box_edges(body["position"], body["size"], upright_rotation(body["yaw"], up))


def _arrow(obstacle: ObstacleEntry) -> Float64Array | None:
    velocity = obstacle["velocity"]
    if velocity is None or obstacle["motion"] == "in_place":
        return None
    if obstacle["speed"] < _SLOWEST_ARROW_MPS:
        return None
    start = np.array(obstacle["position"])
    return np.stack([start, start + np.array(velocity) * _ARROW_S])


def _tag(obstacle: ObstacleEntry, up: Float64Array) -> Tag:
    half = float(np.max(obstacle["size"])) / 2
    position = np.array(obstacle["position"]) + up * (half + _LABEL_ABOVE_M)
    text = obstacle_label(
        obstacle["id"], obstacle["motion"], obstacle["speed"], obstacle["speed_std"]
    )
    return Tag(text, position)


def _stacked(parts: list[Float64Array], edges: int | None) -> Float64Array:
    shape = (0, 2, 3) if edges is None else (0, edges, 2, 3)
    return np.stack(parts) if parts else np.zeros(shape)
