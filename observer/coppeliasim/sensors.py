"""The stereo camera's two vision sensors, found or mounted on a robot, and their images.

They are searched by name first, ignoring case; then any two sensors side by side are taken.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCalibration
from observer.coppeliasim.connection import (
    Connection,
    CoppeliaSimError,
    CoppeliaSimUnreachable,
)
from observer.coppeliasim.pioneers import Pioneer
from observer.coppeliasim.poses import R_SENSOR_CAMERA, pose_numbers, pose_of
from observer.errors import CalibrationError
from observer.geometry import Float64Array, Pose
from observer.types import Image

LEFT_NAME, RIGHT_NAME = "leftCamera", "rightCamera"
WIDTH, HEIGHT, VIEW_ANGLE_DEG = 512, 256, 60.0
# Mount of created sensors on their robot, metres and radians.
BASELINE_M, FORWARD_M, ABOVE_FLOOR_M, TILT_RAD = 0.12, 0.14, 0.34, math.radians(6.0)
NEAR_M, FAR_M = 0.05, 20.0
# Bits of sim.createVisionSensor: explicit handling, perspective projection.
_EXPLICIT, _PERSPECTIVE = 1, 2
_LARGEST_BASELINE_M = 1.0
# A pair that deviates by less counts as exactly parallel: it would not be visible in the images.
_ROUNDING = 1e-5


@dataclass(frozen=True, eq=False)
class Sensor:
    """A vision sensor: its handle, path and alias, size in pixels, view angle in radians."""

    handle: int
    path: str
    name: str
    width: int
    height: int
    view_angle: float

    @property
    def K(self) -> Float64Array:
        """(3, 3) camera matrix; pixel centres are integers, so the middle of 512 is 255.5."""
        # The view angle is that of the larger dimension.
        f = max(self.width, self.height) / 2 / math.tan(self.view_angle / 2)
        return np.array([[f, 0, (self.width - 1) / 2], [0, f, (self.height - 1) / 2], [0, 0, 1]])

    def T_room_camera(self, connection: Connection) -> Pose:
        """Ask for its current pose, with OpenCV's axes."""
        return pose_of(connection, self.handle) @ Pose(R_SENSOR_CAMERA, np.zeros(3))

    def image(self, connection: Connection) -> Image:
        """Fetch the image (H, W, 3) BGR, top row first, that it took when it was last handled.

        Raises:
            CoppeliaSimError: the image does not have the size it had when the sensor was opened.
        """
        given = connection.call("getVisionSensorImg", self.handle)
        content, size = given if isinstance(given, tuple) and len(given) == 2 else (None, None)
        expected = self.width * self.height * 3
        if not isinstance(content, bytes) or len(content) != expected or size is None:
            got = f"{len(content)} bytes" if isinstance(content, bytes) else "no image"
            raise CoppeliaSimError(
                f"{self.path} of CoppeliaSim at {connection.address} returned {got} (reported size "
                f"{size}), not a {self.width}x{self.height} colour image; reopen the source after "
                "changing a vision sensor"
            )
        if list(size) != [self.width, self.height]:
            raise CoppeliaSimError(
                f"{self.path} of CoppeliaSim at {connection.address} now has "
                f"{'x'.join(str(n) for n in size)} pixels, not {self.width}x{self.height} as when "
                "it was opened; reopen the source"
            )
        rgb = np.frombuffer(content, np.uint8).reshape(self.height, self.width, 3)
        return np.ascontiguousarray(rgb[::-1, :, ::-1])


@dataclass(frozen=True, eq=False)
class StereoSensors:
    """Left and right sensor, and their stereo calibration."""

    left: Sensor
    right: Sensor
    calibration: StereoCalibration


def find_sensors(connection: Connection) -> StereoSensors | None:
    """Find the scene's stereo camera; None if no two sensors are side by side.

    Raises:
        CoppeliaSimError: two sensors have the expected names, but are not a stereo camera.
    """
    every = _all_sensors(connection)
    named = (
        [s for s in every if s.name.lower() == name.lower()] for name in (LEFT_NAME, RIGHT_NAME)
    )
    refusal: CoppeliaSimError | None = None
    for left, right in itertools.product(*named):
        try:
            return _stereo(connection, left, right)
        except CoppeliaSimUnreachable:
            raise
        except CoppeliaSimError as error:
            refusal = refusal or error
    if refusal is not None:
        raise refusal
    poses = {sensor.handle: sensor.T_room_camera(connection) for sensor in every}
    pairs = []
    for left, right in itertools.permutations(every, 2):
        T = poses[left.handle].inverse() @ poses[right.handle]
        x, y, z = T.translation.tolist()
        side_by_side = 0 < x <= _LARGEST_BASELINE_M and math.hypot(y, z) < x / 10
        if side_by_side and _alike(left, right) and np.linalg.norm(T.rotvec) < math.radians(5):
            pairs.append((x, left, right))
    if not pairs:
        return None
    _, left, right = min(pairs, key=lambda pair: pair[0])
    return _stereo(connection, left, right)


def create_sensors(connection: Connection, robot: Pioneer) -> StereoSensors:
    """Mount a stereo camera on a robot: 512x256 pixels at 60 degrees."""
    T_room_base = robot.T_room_base(connection)
    tilt = Pose.from_rotvec([0.0, TILT_RAD, 0.0], np.zeros(3)).rotation
    # The sensor looks along the base's x, its y up and its x left.
    R_base_sensor = tilt @ np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    made = []
    for name, side in ((LEFT_NAME, 0.5), (RIGHT_NAME, -0.5)):
        handle = connection.call(
            "createVisionSensor",
            _EXPLICIT | _PERSPECTIVE,
            [WIDTH, HEIGHT, 0, 0],
            [NEAR_M, FAR_M, math.radians(VIEW_ANGLE_DEG), 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
        at = np.array([FORWARD_M, side * BASELINE_M, ABOVE_FLOOR_M])
        T_room_sensor = T_room_base @ Pose(R_base_sensor, at)
        connection.call("setObjectAlias", handle, name)
        connection.call("setObjectPose", handle, pose_numbers(T_room_sensor))
        connection.call("setObjectParent", handle, robot.handle, True)
        made.append(_sensor(connection, handle))
    return _stereo(connection, *made)


def _all_sensors(connection: Connection) -> list[Sensor]:
    """Find all perspective sensors; orthographic ones are not cameras."""
    perspective = connection.constant("visionintparam_perspective_operation")
    return [
        _sensor(connection, handle)
        for handle in connection.objects("visionsensor")
        if connection.call("getObjectInt32Param", handle, perspective)
    ]


def _sensor(connection: Connection, handle: int) -> Sensor:
    resolution = [connection.constant(f"visionintparam_resolution_{axis}") for axis in "xy"]
    width, height = (
        int(connection.number("getObjectInt32Param", handle, each)) for each in resolution
    )
    angle = connection.constant("visionfloatparam_perspective_angle")
    view_angle = connection.number("getObjectFloatParam", handle, angle)
    path = str(connection.call("getObjectAlias", handle, 1))
    name = str(connection.call("getObjectAlias", handle))
    return Sensor(handle, path, name, width, height, view_angle)


def _alike(a: Sensor, b: Sensor) -> bool:
    return (a.width, a.height) == (b.width, b.height) and abs(a.view_angle - b.view_angle) < 1e-4


def _stereo(connection: Connection, left: Sensor, right: Sensor) -> StereoSensors:
    if not _alike(left, right):
        sizes = [
            f"{s.path} {s.width}x{s.height} at {math.degrees(s.view_angle):.4g} degrees"
            for s in (left, right)
        ]
        raise CoppeliaSimError(
            f"the vision sensors of CoppeliaSim at {connection.address} differ: "
            f"{' and '.join(sizes)}; give both the same resolution and view angle"
        )
    T_right_left = right.T_room_camera(connection).inverse() @ left.T_room_camera(connection)
    R, T = T_right_left.rotation, T_right_left.translation
    if np.abs(R - np.eye(3)).max() < _ROUNDING:
        R = np.eye(3)
        if np.abs(T[1:]).max() < _ROUNDING:
            T = np.array([T[0], 0.0, 0.0])
    K, D = left.K, np.zeros(5)
    try:
        calibration = StereoCalibration(left.width, left.height, K, D, K, D, R, T)
        calibration.check_side_by_side()
    except CalibrationError as error:
        raise CoppeliaSimError(
            f"{left.path} and {right.path} of CoppeliaSim at {connection.address} are not a stereo "
            f"camera: {error}"
        ) from None
    return StereoSensors(left, right, calibration)
