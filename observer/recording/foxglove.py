"""Messages of Foxglove and Lichtblick, made of ours.

Frames are those of ``observer.recording.camera_frames``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from foxglove import messages as fox
from numpy.typing import ArrayLike, NDArray

from observer.camera import StereoCalibration
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount
from observer.recording.camera_frames import camera_model, fixed_frames
from observer.recording.images import RAW_DATA, field_head
from observer.types import Image, Odometry
from observer.vision.rectification import Rectification

_MOVING = fox.Color(r=1.0, g=0.85, b=0.0, a=0.45)
_STOPPED = fox.Color(r=0.3, g=0.6, b=1.0, a=0.45)
_COASTING = fox.Color(r=0.6, g=0.6, b=0.6, a=0.3)
_ARROW = fox.Color(r=1.0, g=0.3, b=0.0, a=0.9)
_TEXT = fox.Color(r=1.0, g=1.0, b=1.0, a=1.0)
_TRUE = fox.Color(r=0.1, g=0.9, b=0.3, a=1.0)
_DASHES = 5
# An arrow is as long as the way of one second.
_SHORTEST_ARROW_MPS = 0.02
LogLevel = Literal["debug", "info", "warning", "error"]
_LEVELS = {
    "debug": fox.LogLevel.Debug,
    "info": fox.LogLevel.Info,
    "warning": fox.LogLevel.Warning,
    "error": fox.LogLevel.Error,
}


def stamp(wall_ns: int) -> fox.Timestamp:
    """Return nanoseconds since 1970 as Foxglove's time stamp."""
    return fox.Timestamp(*divmod(wall_ns, 1_000_000_000))


def raw_image(image: Image, side: str, wall_ns: int) -> bytes:
    """Return a ``RawImage`` of (H, W) grey or (H, W, 3) BGR, every pixel as it is."""
    height, width = image.shape[:2]
    head = fox.RawImage(
        timestamp=stamp(wall_ns),
        frame_id=f"camera_{side}",
        width=width,
        height=height,
        encoding="mono8" if image.ndim == 2 else "bgr8",
        step=width * (1 if image.ndim == 2 else 3),
    ).encode()
    # Fields may stand in any order: with the pixels behind the others they are copied only once.
    return b"".join((head, field_head(RAW_DATA, image.nbytes), np.ascontiguousarray(image).data))


def jpeg_image(jpeg: bytes, side: str, wall_ns: int) -> bytes:
    """Return a ``CompressedImage`` of JPEG bytes."""
    return fox.CompressedImage(
        timestamp=stamp(wall_ns), frame_id=f"camera_{side}", data=jpeg, format="jpeg"
    ).encode()


class Cameras:
    """Messages that follow from calibration and mount, the same for all of a recording."""

    def __init__(self, calibration: StereoCalibration, mount: CameraMount | None) -> None:
        """
        Raises:
            CalibrationError: the calibration cannot be rectified.
        """
        self._calibration = calibration
        self._rectified = Rectification(calibration)
        self._fixed = fixed_frames(self._rectified, mount)

    def calibration(self, side: Literal["left", "right"], wall_ns: int) -> bytes:
        """Return the ``CameraCalibration`` of one camera, for its images as taken."""
        given = self._calibration
        camera = camera_model(given, self._rectified, side)
        return fox.CameraCalibration(
            timestamp=stamp(wall_ns),
            frame_id=f"camera_{side}",
            width=given.width,
            height=given.height,
            distortion_model="kannala_brandt" if camera.model == "equidistant" else camera.model,
            D=camera.D.tolist(),
            K=camera.K.ravel().tolist(),
            R=camera.R.ravel().tolist(),
            P=camera.P.ravel().tolist(),
        ).encode()

    def transforms(self, T_world_camera: Pose | None, wall_ns: int) -> bytes:
        """Return ``FrameTransforms``, without the camera's pose where that is unknown."""
        poses = list(self._fixed)
        if T_world_camera is not None:
            poses.append(("world", "camera", T_world_camera))
        time = stamp(wall_ns)
        return fox.FrameTransforms(
            transforms=[
                fox.FrameTransform(
                    timestamp=time,
                    parent_frame_id=parent,
                    child_frame_id=child,
                    translation=_vector(T.translation),
                    rotation=_quaternion(T.quaternion_wxyz),
                )
                for parent, child, T in poses
            ]
        ).encode()


def obstacle_scene(line: Mapping[str, Any], wall_ns: int) -> bytes:
    """Return a ``SceneUpdate`` of a line's obstacles: box, velocity arrow and label, world."""
    entities = []
    for obstacle in line["obstacles"]:
        if obstacle["position"] is None or obstacle["orientation_wxyz"] is None:
            continue
        std = obstacle["speed_std"]
        sure = "" if std is None else f" ± {std:.2f}"
        entities.append(
            _entity(
                f"obstacle {obstacle['id']}",
                wall_ns,
                position=obstacle["position"],
                height_m=_height(obstacle["size"][1]),
                text=f"{obstacle['id']}: {obstacle['speed']:.2f}{sure} m/s",
                velocity=obstacle["velocity"],
                color=_ARROW,
                cubes=[
                    fox.CubePrimitive(
                        pose=_pose(obstacle["position"], obstacle["orientation_wxyz"]),
                        size=_vector(obstacle["size"]),
                        color=_color(obstacle),
                    )
                ],
            )
        )
    return _scene(entities, wall_ns)


def truth_scene(bodies: Sequence[Mapping[str, Any]], wall_ns: int) -> bytes:
    """Return a ``SceneUpdate`` of true bodies in the observation's world: dashed box, arrow, label.

    Args:
        bodies: fields of ``MatchedBody`` by name.
    """
    entities = []
    for body in bodies:
        half_yaw = body["yaw"] / 2
        pose = _pose(body["position"], (math.cos(half_yaw), 0.0, math.sin(half_yaw), 0.0))
        length, width, height = body["size"]
        entities.append(
            _entity(
                f"{body['role']} {body['name']}",
                wall_ns,
                position=body["position"],
                height_m=_height(height),
                text=f"{body['name']}: {body['speed']:.2f} m/s",
                velocity=body["velocity"],
                color=_TRUE,
                lines=[
                    fox.LinePrimitive(
                        type=fox.LinePrimitiveLineType.LineList,
                        pose=pose,
                        thickness=2.0,
                        scale_invariant=True,
                        points=[
                            fox.Point3(x=x, y=y, z=z)
                            for x, y, z in _dashed_box((width, height, length)).tolist()
                        ],
                        color=_TRUE,
                    )
                ],
            )
        )
    return _scene(entities, wall_ns)


def point_cloud(points: NDArray[np.float32], colors: NDArray[np.uint8], wall_ns: int) -> bytes:
    """Return a ``PointCloud`` in the camera frame.

    Args:
        points: (N, 3) metres. colors: (N, 3) RGB.
    """
    packed = np.zeros(len(points), dtype=[("point", "<f4", 3), ("color", "u1", 4)])
    packed["point"] = points
    packed["color"][:, :3] = colors
    packed["color"][:, 3] = 255
    number = fox.PackedElementFieldNumericType
    fields = [(name, 4 * k, number.Float32) for k, name in enumerate("xyz")]
    fields += [
        (name, 12 + k, number.Uint8) for k, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    return fox.PointCloud(
        timestamp=stamp(wall_ns),
        frame_id="camera",
        pose=_pose((0, 0, 0), (1, 0, 0, 0)),
        point_stride=packed.itemsize,
        fields=[fox.PackedElementField(name=n, offset=o, type=t) for n, o, t in fields],
        data=packed.tobytes(),
    ).encode()


def odometry(told: Odometry, wall_ns: int) -> bytes:
    """Return ``Odometry`` by the robot's wheels."""
    half = told.yaw / 2
    return fox.Odometry(
        timestamp=stamp(wall_ns),
        frame_id="odom",
        body_frame_id="base",
        pose=_pose((told.x, told.y, 0), (math.cos(half), 0, 0, math.sin(half))),
    ).encode()


def log(level: LogLevel, name: str, message: str, wall_ns: int) -> bytes:
    """Return a ``Log``."""
    return fox.Log(
        timestamp=stamp(wall_ns), level=_LEVELS[level], message=message, name=name
    ).encode()


def _scene(entities: list[fox.SceneEntity], wall_ns: int) -> bytes:
    # Delete what was drawn before, so that nothing stays that is no longer seen.
    gone = fox.SceneEntityDeletion(
        timestamp=stamp(wall_ns), type=fox.SceneEntityDeletionType.All, id=""
    )
    return fox.SceneUpdate(deletions=[gone], entities=entities).encode()


def _entity(
    id_: str,
    wall_ns: int,
    *,
    position: Sequence[float],
    height_m: float,
    text: str,
    velocity: Sequence[float],
    color: fox.Color,
    cubes: list[fox.CubePrimitive] | None = None,
    lines: list[fox.LinePrimitive] | None = None,
) -> fox.SceneEntity:
    speed = math.hypot(*velocity)
    arrows = []
    if speed >= _SHORTEST_ARROW_MPS:
        head = min(0.15, speed / 2)
        arrows.append(
            fox.ArrowPrimitive(
                pose=_pose(position, _turn_from_x(velocity)),
                shaft_length=speed - head,
                shaft_diameter=0.04,
                head_length=head,
                head_diameter=0.1,
                color=color,
            )
        )
    x, y, z = position
    label = fox.TextPrimitive(
        # y points down.
        pose=_pose((x, y - height_m / 2 - 0.15, z), (1, 0, 0, 0)),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=_TEXT if color is not _TRUE else _TRUE,
        text=text,
    )
    return fox.SceneEntity(
        timestamp=stamp(wall_ns),
        frame_id="world",
        id=id_,
        arrows=arrows,
        cubes=cubes or [],
        lines=lines or [],
        texts=[label],
    )


def _color(obstacle: Mapping[str, Any]) -> fox.Color:
    if obstacle["state"] == "coasting":
        return _COASTING
    return _MOVING if obstacle["motion"] == "moving" else _STOPPED


def _height(size: float) -> float:
    return float(size) if math.isfinite(size) else 0.0


def _dashed_box(size: ArrayLike) -> Float64Array:
    """Return the ends (2 N, 3) of dashes along the 12 edges of a box about its centre."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    edges = [
        (a, b) for a in corners for b in corners if (a <= b).all() and np.count_nonzero(a != b) == 1
    ]
    # A dash and a gap of equal length, a dash at both ends.
    steps = np.arange(2 * _DASHES) / (2 * _DASHES - 1)
    points = [a + s * (b - a) for a, b in edges for s in steps]
    return np.asarray(np.array(points) * np.asarray(size, dtype=np.float64))


def _turn_from_x(direction: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the shortest rotation (w, x, y, z) of the x axis into a non-zero direction."""
    length = math.hypot(*direction)
    x, y, z = (value / length for value in direction)
    aside = y * y + z * z
    if aside == 0:
        return (1.0, 0.0, 0.0, 0.0) if x > 0 else (0.0, 0.0, 0.0, 1.0)
    # Half of the turn: between the axis and the direction lies their sum, whose part along the
    # axis, 1 + x, has no digits left where they are opposite.
    ahead = 1 + x if x > 0 else aside / (1 - x)
    norm = math.sqrt(2 * ahead)
    return norm / 2, 0.0, -z / norm, y / norm


def _vector(values: ArrayLike) -> fox.Vector3:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return fox.Vector3(x=x, y=y, z=z)


def _quaternion(wxyz: ArrayLike) -> fox.Quaternion:
    w, x, y, z = np.asarray(wxyz, dtype=np.float64).tolist()
    return fox.Quaternion(x=x, y=y, z=z, w=w)


def _pose(position: ArrayLike, wxyz: ArrayLike) -> fox.Pose:
    return fox.Pose(position=_vector(position), orientation=_quaternion(wxyz))
