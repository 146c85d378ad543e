"""Messages of Foxglove and Lichtblick, made from ours.

Frames are those of ``observer.recording.camera_frames``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
from foxglove import messages as fox
from numpy.typing import ArrayLike, NDArray

from observer.camera import StereoCalibration
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount
from observer.recording.camera_frames import camera_model, fixed_frames
from observer.recording.drawn import VELOCITY, WHITE, DrawnBody, Rgba
from observer.recording.images import RAW_DATA, field_head
from observer.types import Image, Odometry
from observer.vision.rectification import Rectification

# Dashes along each edge of a true body's box.
_DASHES = 5
_POINTS_PER_EDGE = 16
LogLevel = Literal["debug", "info", "warning", "error"]


def stamp(wall_ns: int) -> fox.Timestamp:
    """Return nanoseconds since 1970 as Foxglove's time stamp."""
    return fox.Timestamp(*divmod(wall_ns, 1_000_000_000))


def raw_image(image: Image, side: str, wall_ns: int) -> bytes:
    """Return a lossless ``RawImage`` of (H, W) grey or (H, W, 3) BGR."""
    height, width = image.shape[:2]
    head = fox.RawImage(
        timestamp=stamp(wall_ns),
        frame_id=f"camera_{side}",
        width=width,
        height=height,
        encoding="mono8" if image.ndim == 2 else "bgr8",
        step=width * (1 if image.ndim == 2 else 3),
    ).encode()
    # Fields may come in any order: with the pixels last, they are copied only once.
    return b"".join((head, field_head(RAW_DATA, image.nbytes), np.ascontiguousarray(image).data))


def jpeg_image(jpeg: bytes, side: str, wall_ns: int) -> bytes:
    """Return a ``CompressedImage`` of JPEG bytes."""
    return fox.CompressedImage(
        timestamp=stamp(wall_ns), frame_id=f"camera_{side}", data=jpeg, format="jpeg"
    ).encode()


class Cameras:
    """Messages derived from calibration and mount, constant throughout a recording."""

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


def scene(bodies: Sequence[DrawnBody], wall_ns: int) -> bytes:
    """Return a ``SceneUpdate`` of boxes, dashed for true bodies, velocity arrows and labels."""
    # Delete the previous drawing, so that nothing remains that is no longer seen.
    gone = fox.SceneEntityDeletion(
        timestamp=stamp(wall_ns), type=fox.SceneEntityDeletionType.All, id=""
    )
    entities = [_entity(body, wall_ns) for body in bodies]
    return fox.SceneUpdate(deletions=[gone], entities=entities).encode()


def box_edges(bodies: Sequence[DrawnBody], wall_ns: int) -> bytes:
    """Return a ``PointCloud``, world frame, of points along the edges of the bodies' boxes.

    For tools that show points but no ``SceneUpdate``. Bodies of unknown size are left out.
    """
    bodies = [body for body in bodies if np.isfinite(body.size).all()]
    corners = [_edge_points(body) for body in bodies]
    colors = [
        np.tile(np.array(body.color[:3]) * 255, (len(points), 1))
        for body, points in zip(bodies, corners, strict=True)
    ]
    return point_cloud(
        np.concatenate([np.zeros((0, 3)), *corners]).astype(np.float32),
        np.concatenate([np.zeros((0, 3)), *colors]).astype(np.uint8),
        wall_ns,
        frame="world",
    )


def _edge_points(body: DrawnBody) -> Float64Array:
    """(N, 3) metres, world: points along the twelve edges of a box."""
    pose = Pose.from_quaternion(body.wxyz, body.position)
    return pose.apply(_unit_edges() * np.asarray(body.size))


@cache
def _unit_edges() -> Float64Array:
    """(N, 3) points along the edges of a unit cube about its centre."""
    steps = np.linspace(-0.5, 0.5, _POINTS_PER_EDGE)
    grid = np.stack(np.meshgrid(steps, (-0.5, 0.5), (-0.5, 0.5), indexing="ij"), axis=-1)
    along_x = grid.reshape(-1, 3)
    return np.concatenate([np.roll(along_x, axis, axis=1) for axis in range(3)])


def point_cloud(
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
    wall_ns: int,
    *,
    frame: Literal["camera", "world"] = "camera",
) -> bytes:
    """Return a ``PointCloud``.

    Args:
        points: (N, 3) metres, in ``frame``. colors: (N, 3) RGB.
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
        frame_id=frame,
        pose=_pose((0, 0, 0), (1, 0, 0, 0)),
        point_stride=packed.itemsize,
        fields=[fox.PackedElementField(name=n, offset=o, type=t) for n, o, t in fields],
        data=packed.tobytes(),
    ).encode()


def odometry(place: Odometry, wall_ns: int) -> bytes:
    """Return the ``Odometry`` of the robot's wheels."""
    half = place.yaw / 2
    return fox.Odometry(
        timestamp=stamp(wall_ns),
        frame_id="odom",
        body_frame_id="base",
        pose=_pose((place.x, place.y, 0), (math.cos(half), 0, 0, math.sin(half))),
    ).encode()


def log(level: LogLevel, name: str, message: str, wall_ns: int) -> bytes:
    """Return a ``Log``."""
    known = getattr(fox.LogLevel, level.capitalize())
    return fox.Log(timestamp=stamp(wall_ns), level=known, message=message, name=name).encode()


def _entity(body: DrawnBody, wall_ns: int) -> fox.SceneEntity:
    color, pose = _color(body.color), _pose(body.position, body.wxyz)
    cubes, lines, arrows = [], [], []
    if body.true:
        ends = _dashed_box(body.size).tolist()
        lines.append(
            fox.LinePrimitive(
                type=fox.LinePrimitiveLineType.LineList,
                pose=pose,
                thickness=2.0,
                scale_invariant=True,
                points=[fox.Point3(x=x, y=y, z=z) for x, y, z in ends],
                color=color,
            )
        )
    else:
        cubes.append(fox.CubePrimitive(pose=pose, size=_vector(body.size), color=color))
    if body.arrow_m:
        head = min(0.15, body.arrow_m / 2)
        arrows.append(
            fox.ArrowPrimitive(
                pose=_pose(body.position, _turn_from_x(body.velocity)),
                shaft_length=body.arrow_m - head,
                shaft_diameter=0.04,
                head_length=head,
                head_diameter=0.1,
                color=color if body.true else _color(VELOCITY),
            )
        )
    height = body.size[1]
    above = body.label_position(height if math.isfinite(height) else 0.0)
    label = fox.TextPrimitive(
        pose=_pose(above, (1, 0, 0, 0)),
        billboard=True,
        font_size=14.0,
        scale_invariant=True,
        color=color if body.true else _color(WHITE),
        text=body.text,
    )
    return fox.SceneEntity(
        timestamp=stamp(wall_ns),
        frame_id="world",
        id=f"{body.kind} {body.name}",
        arrows=arrows,
        cubes=cubes,
        lines=lines,
        texts=[label],
    )


def _color(rgba: Rgba) -> fox.Color:
    r, g, b, a = rgba
    return fox.Color(r=r, g=g, b=b, a=a)


def _dashed_box(size: ArrayLike) -> Float64Array:
    """Return the ends (2 N, 3) of dashes along the 12 edges of a box about its centre."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    edges = [
        (a, b) for a in corners for b in corners if (a <= b).all() and np.count_nonzero(a != b) == 1
    ]
    # Dashes and gaps of equal length, with a dash at both ends.
    steps = np.arange(2 * _DASHES) / (2 * _DASHES - 1)
    points = [a + s * (b - a) for a, b in edges for s in steps]
    return np.asarray(np.array(points) * np.asarray(size, dtype=np.float64))


def _turn_from_x(direction: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the smallest rotation (w, x, y, z) from the x axis to a non-zero direction."""
    length = math.hypot(*direction)
    x, y, z = (value / length for value in direction)
    aside = y * y + z * z
    if aside == 0:
        return (1.0, 0.0, 0.0, 0.0) if x > 0 else (0.0, 0.0, 0.0, 1.0)
    # The sum of axis and direction lies at half the angle. Its part along the axis, 1 + x, loses
    # all digits to cancellation where they are nearly opposite.
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
