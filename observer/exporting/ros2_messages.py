"""ROS 2 messages made from a run's, with the ``rosbags`` package.

Frames are those of ``observer.recording.camera_frames``; times are those of ``ExposureClock``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from observer.exporting.errors import ExportError
from observer.exporting.foxglove_messages import RecordedCloud, RecordedLog
from observer.extras import package_missing
from observer.geometry import Pose
from observer.recording.camera_frames import CameraModel
from observer.recording.drawn import VELOCITY, WHITE, DrawnBody, Rgba
from observer.types import Image, Odometry

# visualization_msgs/msg/Marker.
_ARROW, _CUBE, _TEXT = 0, 1, 9
_ADD, _DELETE_ALL = 0, 3
_UNTURNED = (1, 0, 0, 0)
# sensor_msgs/msg/PointField.
_FLOAT32 = 7
# rcl_interfaces/msg/Log, by Foxglove's level.
_LEVELS = {1: 10, 2: 20, 3: 30, 4: 40, 5: 50}
# nav_msgs and geometry_msgs have no value for unknown; robot_localization and others treat so large
# a variance as that.
_UNKNOWN_VARIANCE = 1e6

# A cube without extent is not drawn.
_LEAST_EXTENT_M = 0.01
# Opacity of a true body's box, which is solid here.
_TRUE_ALPHA = 0.35


class RosMessages:
    """Makes messages of the types shared by ROS 2 Humble and all later versions.

    Attributes:
        store: rosbags' type store, which serialises them to CDR.

    Raises:
        ExportError: rosbags is not installed.
    """

    def __init__(self) -> None:
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise ExportError(package_missing("a ROS 2 bag", "ros", "rosbags")) from None
        self.store: Any = get_typestore(Stores.ROS2_HUMBLE)

    def _make(self, name: str, *fields: Any, **named: Any) -> Any:
        return self.store.types[name](*fields, **named)

    def _time(self, wall_ns: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", *divmod(wall_ns, 1_000_000_000))

    def _header(self, wall_ns: int, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", self._time(wall_ns), frame)

    def _xyz(self, kind: str, values: ArrayLike) -> Any:
        x, y, z = np.asarray(values, dtype=np.float64).tolist()
        return self._make(f"geometry_msgs/msg/{kind}", x, y, z)

    def _quaternion(self, wxyz: ArrayLike) -> Any:
        w, x, y, z = np.asarray(wxyz, dtype=np.float64).tolist()
        return self._make("geometry_msgs/msg/Quaternion", x, y, z, w)

    def _pose(self, position: ArrayLike, wxyz: ArrayLike) -> Any:
        return self._make(
            "geometry_msgs/msg/Pose", self._xyz("Point", position), self._quaternion(wxyz)
        )

    # --- images ------------------------------------------------------------------------------

    def compressed(self, jpeg: memoryview, side: str, wall_ns: int) -> Any:
        """Return a ``sensor_msgs/CompressedImage`` with the recorded JPEG, unchanged."""
        return self._make(
            "sensor_msgs/msg/CompressedImage",
            self._header(wall_ns, f"camera_{side}"),
            "jpeg",
            np.frombuffer(jpeg, np.uint8),
        )

    def image(self, pixels: Image, side: str, wall_ns: int) -> Any:
        """Return a ``sensor_msgs/Image`` of (H, W) grey or (H, W, 3) BGR."""
        height, width = pixels.shape[:2]
        grey = pixels.ndim == 2
        return self._make(
            "sensor_msgs/msg/Image",
            self._header(wall_ns, f"camera_{side}"),
            height,
            width,
            "mono8" if grey else "bgr8",
            0,
            width * (1 if grey else 3),
            np.ascontiguousarray(pixels).reshape(-1),
        )

    def camera_info(
        self, camera: CameraModel, width: int, height: int, side: str, wall_ns: int
    ) -> Any:
        """Return the ``sensor_msgs/CameraInfo`` of the images as taken (REP-104)."""
        return self._make(
            "sensor_msgs/msg/CameraInfo",
            self._header(wall_ns, f"camera_{side}"),
            height,
            width,
            camera.model,
            np.array(camera.D, dtype=np.float64),
            np.array(camera.K, dtype=np.float64).ravel(),
            np.array(camera.R, dtype=np.float64).ravel(),
            camera.P.ravel(),
            0,
            0,
            self._make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False),
        )

    def cloud(self, recorded: RecordedCloud, wall_ns: int) -> Any:
        """Return a ``sensor_msgs/PointCloud2`` with x, y, z and rgb, in the camera frame."""
        packed = np.zeros(len(recorded.points), dtype=[("xyz", "<f4", 3), ("bgra", "u1", 4)])
        packed["xyz"] = recorded.points
        packed["bgra"][:, :3] = recorded.colors[:, ::-1]
        fields = [
            self._make("sensor_msgs/msg/PointField", name, 4 * k, _FLOAT32, 1)
            for k, name in enumerate(("x", "y", "z", "rgb"))
        ]
        return self._make(
            "sensor_msgs/msg/PointCloud2",
            self._header(wall_ns, "camera"),
            1,
            len(packed),
            fields,
            False,
            packed.itemsize,
            packed.nbytes,
            np.frombuffer(packed.tobytes(), np.uint8),
            True,
        )

    # --- poses -------------------------------------------------------------------------------

    def transforms(self, poses: Sequence[tuple[str, str, Pose]], wall_ns: int) -> Any:
        """Return a ``tf2_msgs/TFMessage`` of (parent, child, ``T_parent_child``)."""
        return self._make(
            "tf2_msgs/msg/TFMessage",
            [
                self._make(
                    "geometry_msgs/msg/TransformStamped",
                    self._header(wall_ns, parent),
                    child,
                    self._make(
                        "geometry_msgs/msg/Transform",
                        self._xyz("Vector3", T.translation),
                        self._quaternion(T.quaternion_wxyz),
                    ),
                )
                for parent, child, T in poses
            ],
        )

    def pose(self, T_world_camera: Pose, wall_ns: int) -> Any:
        """Return the ``geometry_msgs/PoseStamped`` of the camera in the world."""
        return self._make(
            "geometry_msgs/msg/PoseStamped",
            self._header(wall_ns, "world"),
            self._pose(T_world_camera.translation, T_world_camera.quaternion_wxyz),
        )

    def odometry(self, place: Odometry, wall_ns: int) -> Any:
        """Return the wheels' ``nav_msgs/Odometry``; twist and variances are unknown."""
        unknown = np.diag(np.full(6, _UNKNOWN_VARIANCE)).ravel()
        half = place.yaw / 2
        zero = self._xyz("Vector3", (0, 0, 0))
        return self._make(
            "nav_msgs/msg/Odometry",
            self._header(wall_ns, "odom"),
            "base",
            self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                self._pose((place.x, place.y, 0), (math.cos(half), 0, 0, math.sin(half))),
                unknown,
            ),
            self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                self._make("geometry_msgs/msg/Twist", zero, zero),
                unknown,
            ),
        )

    # --- results, as text and boxes ----------------------------------------------------------

    def bodies(self, bodies: Sequence[DrawnBody], wall_ns: int) -> Any:
        """Return a ``visualization_msgs/MarkerArray``: box, velocity and label of each."""
        nowhere = self._pose((0, 0, 0), _UNTURNED)
        # Deletes the previous markers, so that nothing remains that is no longer seen.
        clearing = self._marker(
            wall_ns, "", 0, 0, WHITE, nowhere, (0.0, 0.0, 0.0), action=_DELETE_ALL
        )
        markers = [marker for body in bodies for marker in self._body(body, wall_ns)]
        return self._make("visualization_msgs/msg/MarkerArray", [clearing, *markers])

    def text(self, text: str) -> Any:
        """Return a ``std_msgs/String``."""
        return self._make("std_msgs/msg/String", text)

    def log(self, entry: RecordedLog, wall_ns: int) -> Any:
        """Return a ``rcl_interfaces/Log``."""
        level = _LEVELS.get(entry.level, 20)
        at = self._time(wall_ns)
        return self._make("rcl_interfaces/msg/Log", at, level, entry.name, entry.text, "", "", 0)

    def _body(self, body: DrawnBody, wall_ns: int) -> Iterator[Any]:
        size = [s if math.isfinite(s) else 0.0 for s in body.size]
        extent = [max(_LEAST_EXTENT_M, s) for s in size]
        color = (*body.color[:3], _TRUE_ALPHA) if body.true else body.color
        box = self._pose(body.position, body.wxyz)
        yield self._marker(wall_ns, body.kind, body.id, _CUBE, color, box, extent)
        if body.arrow_m:
            tip = np.add(body.position, body.velocity)
            yield self._marker(
                wall_ns,
                f"{body.kind} velocity",
                body.id,
                _ARROW,
                VELOCITY,
                self._pose((0, 0, 0), _UNTURNED),
                (0.04, 0.1, 0.0),
                points=[self._xyz("Point", end) for end in (body.position, tip)],
            )
        above = self._pose(body.label_position(extent[1]), _UNTURNED)
        scale = (0.0, 0.0, 0.12)
        yield self._marker(
            wall_ns, f"{body.kind} label", body.id, _TEXT, WHITE, above, scale, text=body.text
        )

    def _marker(
        self,
        wall_ns: int,
        ns: str,
        id_: int,
        kind: int,
        color: Rgba,
        pose: Any,
        scale: Sequence[float],
        points: Sequence[Any] = (),
        text: str = "",
        action: int = _ADD,
    ) -> Any:
        nothing = np.zeros(0, np.uint8)
        return self._make(
            "visualization_msgs/msg/Marker",
            header=self._header(wall_ns, "world"),
            ns=ns,
            id=id_,
            type=kind,
            action=action,
            pose=pose,
            scale=self._xyz("Vector3", scale),
            color=self._make("std_msgs/msg/ColorRGBA", *color),
            lifetime=self._make("builtin_interfaces/msg/Duration", 0, 0),
            frame_locked=False,
            points=list(points),
            colors=[],
            texture_resource="",
            texture=self._make("sensor_msgs/msg/CompressedImage", self._header(0, ""), "", nothing),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", "", nothing),
            mesh_use_embedded_materials=False,
        )
